"""The state machine of a session: which stage follows which, on what event.

`advance` is pure: it takes the plan, the session's progress and an event, and returns the new
progress or raises a ProtocolError. Times are part of the events.
"""

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum
from typing import NotRequired, Self, TypedDict

from .plan import Plan
from .stage_settings import Device
from .time_left import seconds_left


class Stage(StrEnum):
    """A stage of a session."""

    CONSENT = "consent"
    DEVICE_CHECK = "device_check"
    INSTRUCTIONS = "instructions"
    FAMILIARISATION = "familiarisation"
    PRACTICE = "practice"
    QUERY = "query"
    QUESTIONNAIRE = "questionnaire"
    BREAK = "break"
    DEBRIEF = "debrief"
    COMPLETED = "completed"
    WITHDRAWN = "withdrawn"
    DECLINED = "declined"
    SCREENED_OUT = "screened_out"


FINAL_STAGES = frozenset({Stage.COMPLETED, Stage.WITHDRAWN, Stage.DECLINED, Stage.SCREENED_OUT})
BEFORE_FIRST_TRIAL = frozenset(
    {
        Stage.CONSENT,
        Stage.DEVICE_CHECK,
        Stage.INSTRUCTIONS,
        Stage.PRACTICE,
        Stage.DECLINED,
        Stage.SCREENED_OUT,
    }
)

AFTER_A_TRIAL = frozenset({Stage.QUESTIONNAIRE, Stage.BREAK, Stage.DEBRIEF, Stage.COMPLETED})
#: Pages of stage questionnaire: `Plan.items` takes them.
AFTER_TRIAL, AT_THE_END = 0, 1
#: Stages in which queries are answered.
ANSWERED = frozenset({Stage.PRACTICE, Stage.QUERY})
#: Stages of several pages, which query_index counts.
COUNTING = frozenset({Stage.PRACTICE, Stage.QUERY, Stage.QUESTIONNAIRE})


@dataclass(frozen=True)
class Progress:
    """Where a session is. Read on its own, `trial_index` is how many trials are finished.

    trial_index: 0-based; the trial the session is in, or that comes next (in a break, or while a
        block's videos are watched); the number of trials once all are done.
    query_index: 0-based index of the open query; in stage questionnaire 0 after a trial, 1 at the
        end; 0 in all other stages.
    break_ends_at: only in stage break; timezone-aware.
    """

    stage: Stage
    trial_index: int = 0
    query_index: int = 0
    break_ends_at: datetime | None = None

    def __post_init__(self) -> None:
        if self.trial_index < 0 or self.query_index < 0:
            raise ValueError(f"expected indices of 0 or more, got {self}")
        if self.stage in BEFORE_FIRST_TRIAL and self.trial_index != 0:
            raise ValueError(f"expected trial_index 0 in stage {self.stage}, got {self}")
        if self.stage in AFTER_A_TRIAL and self.trial_index == 0:
            raise ValueError(f"expected a finished trial in stage {self.stage}, got {self}")
        if self.stage not in COUNTING and self.query_index != 0:
            raise ValueError(f"expected query_index 0 in stage {self.stage}, got {self}")
        if (self.stage is Stage.BREAK) != (self.break_ends_at is not None):
            raise ValueError(f"expected break_ends_at in stage break and only there, got {self}")
        if self.break_ends_at is not None:
            _require_timezone(self.break_ends_at)

    @classmethod
    def start(cls) -> Self:
        """The progress of a new session."""
        return cls(Stage.CONSENT)


@dataclass(frozen=True)
class Consented:
    """Agreement to the text of `version`; `current_version` is the one in force."""

    version: str
    current_version: str


@dataclass(frozen=True)
class Continued:
    """A page without other input was left; `watched` counts its videos watched to the end.

    device: the measurements, on the page that makes them.
    """

    at: datetime
    watched: int = 0
    device: Device | None = None

    def __post_init__(self) -> None:
        _require_timezone(self.at)


@dataclass(frozen=True)
class Responded:
    """A response, of any kind, to the query of this index of the current trial.

    is_sure: whether the trial is so sure by it that the plan ends it early.
    """

    query_index: int
    at: datetime
    is_sure: bool = False

    def __post_init__(self) -> None:
        _require_timezone(self.at)


@dataclass(frozen=True)
class Answered:
    """A questionnaire's answers, checked."""

    at: datetime

    def __post_init__(self) -> None:
        _require_timezone(self.at)


@dataclass(frozen=True)
class ScreenedOut:
    """The person has no device that passes the check."""


@dataclass(frozen=True)
class Undone:
    """The response to the query of this index, the one before the open query, is taken back."""

    query_index: int


@dataclass(frozen=True)
class Withdrew:
    """The person stops: declines in stage consent, withdraws later."""


Event = Consented | Continued | Responded | Undone | Answered | ScreenedOut | Withdrew


class ProtocolError(Exception):
    """An event that is not possible in the session's current state."""


class OutOfOrder(ProtocolError):  # noqa: N818 - named for what happened
    """The event belongs to another stage; `expected` says what `stage` requires instead."""

    def __init__(self, stage: Stage, expected: str) -> None:
        super().__init__(f"The session is in stage {stage}: {expected}.")
        self.stage = stage
        self.expected = expected


class StaleConsent(ProtocolError):  # noqa: N818 - named for what happened
    """Consent to a text that is no longer the current one."""

    def __init__(self, current: str, given: str) -> None:
        super().__init__(f"The consent text has changed: expected version {current}, got {given}.")
        self.current = current
        self.given = given


class BreakNotOver(ProtocolError):  # noqa: N818 - named for what happened
    """The break has not ended; `seconds_left` is rounded up."""

    def __init__(self, seconds_left: int) -> None:
        super().__init__(f"The break is not over: expected {seconds_left} s more of rest.")
        self.seconds_left = seconds_left


class WatchMore(ProtocolError):  # noqa: N818 - named for what happened
    """`left` videos of the familiarisation are still to be watched to the end."""

    def __init__(self, required: int, watched: int) -> None:
        self.left = required - watched
        super().__init__(
            f"Some videos are still to be watched: expected {required} watched to the end,"
            f" got {watched}."
        )


class DeviceRefused(ProtocolError):  # noqa: N818 - named for what happened
    """The device fails the check; `lacks` names why: width, clip or line."""

    def __init__(self, lacks: tuple[str, ...]) -> None:
        super().__init__(f"The device did not pass its check: it lacks {', '.join(lacks)}.")
        self.lacks = lacks


class Position(TypedDict):
    """Progress in numbers for people, counted from 1.

    at_most: true where trials may end before the last query; otherwise left out.
    """

    trial: int
    trials: int
    query: int
    queries: int
    at_most: NotRequired[bool]


_TO_BE_DONE = {
    Stage.CONSENT: "the consent has to be given or declined first",
    Stage.DEVICE_CHECK: "the device has to pass its check first",
    Stage.INSTRUCTIONS: "the instructions have to be left first",
    Stage.FAMILIARISATION: "the familiarisation has to be left first",
    Stage.PRACTICE: "the practice queries have to be answered first",
    Stage.QUESTIONNAIRE: "the questionnaire has to be answered first",
    Stage.BREAK: "the break has to be left first",
    Stage.DEBRIEF: "the debriefing has to be left first",
    Stage.COMPLETED: "it is completed, nothing is left to be done",
    Stage.WITHDRAWN: "it was ended by the participant, nothing is left to be done",
    Stage.DECLINED: "the participant declined, nothing is left to be done",
    Stage.SCREENED_OUT: "the device did not pass its check, nothing is left to be done",
}


def advance(plan: Plan, progress: Progress, event: Event) -> Progress:
    """The progress after the event. Raises a ProtocolError if it is not possible now."""
    match event:
        case Withdrew():
            return _after_withdrawal(plan, progress)
        case ScreenedOut():
            if progress.stage is not Stage.DEVICE_CHECK:
                raise _out_of_order(plan, progress)
            return Progress(Stage.SCREENED_OUT)
        case Consented():
            return _after_consent(plan, progress, event)
        case Continued():
            return _after_continue(plan, progress, event)
        case Responded() | Undone():
            return _within_trial(plan, progress, event)
        case Answered():
            return _after_questionnaire(plan, progress, event)


def position(plan: Plan, progress: Progress) -> Position:
    """Progress in numbers for people.

    trial: 0 before the first trial, then the number of the trial in hand; in a break and
    afterwards the number of trials finished. query: the number of the open query; outside stage
    query 0 if no trial is finished yet, else the number of queries in a trial. In the practice
    both numbers of queries are the practice's own. Where trials may end early, `queries` is the
    most that a trial has, and a finished trial counts as having had them.
    """
    trial, query = progress.trial_index, plan.shown_per_trial if progress.trial_index else 0
    if progress.stage is Stage.PRACTICE:
        query, queries = progress.query_index + 1, plan.practice.queries
        return Position(trial=0, trials=plan.trials, query=query, queries=queries)
    if progress.stage is Stage.QUERY:
        trial, query = progress.trial_index + 1, progress.query_index + 1
    at = Position(trial=trial, trials=plan.trials, query=query, queries=plan.shown_per_trial)
    if plan.stop is not None:
        at["at_most"] = True
    return at


def require_asked(plan: Plan, progress: Progress, query_index: int) -> None:
    """Raises OutOfOrder unless the query of this index is the open one."""
    if progress.stage not in ANSWERED or query_index != progress.query_index:
        raise _out_of_order(plan, progress)


def _after_withdrawal(plan: Plan, progress: Progress) -> Progress:
    if progress.stage in FINAL_STAGES:
        raise _out_of_order(plan, progress)
    if progress.stage is Stage.CONSENT:
        return Progress(Stage.DECLINED)
    return Progress(Stage.WITHDRAWN, trial_index=progress.trial_index)


def _after_consent(plan: Plan, progress: Progress, event: Consented) -> Progress:
    if progress.stage is not Stage.CONSENT:
        raise _out_of_order(plan, progress)
    if event.version != event.current_version:
        raise StaleConsent(event.current_version, event.version)
    return Progress(Stage.INSTRUCTIONS if plan.device_check is None else Stage.DEVICE_CHECK)


def _after_continue(plan: Plan, progress: Progress, event: Continued) -> Progress:
    match progress.stage:
        case Stage.DEVICE_CHECK if plan.device_check is not None:
            device = event.device or Device(width_px=0)
            lacks = plan.device_check.shortcomings(device)
            if lacks or event.device is None:
                raise DeviceRefused(lacks or ("measures",))
            return Progress(Stage.INSTRUCTIONS)
        case Stage.INSTRUCTIONS:
            return _toward_trial(plan, progress.trial_index)
        case Stage.FAMILIARISATION:
            if event.watched < plan.familiarisation.required:
                raise WatchMore(plan.familiarisation.required, event.watched)
            return _past_the_videos(plan, progress.trial_index)
        case Stage.BREAK:
            # Progress holds an end for every break.
            assert progress.break_ends_at is not None
            left = seconds_left(plan.break_s, progress.break_ends_at, event.at)
            if left > 0:
                raise BreakNotOver(math.ceil(left))
            return _toward_trial(plan, progress.trial_index)
        case Stage.DEBRIEF:
            return Progress(Stage.COMPLETED, trial_index=progress.trial_index)
        case _:
            raise _out_of_order(plan, progress)


def _after_response(plan: Plan, progress: Progress, event: Responded) -> Progress:
    require_asked(plan, progress, event.query_index)
    if progress.stage is Stage.PRACTICE:
        if progress.query_index + 1 < plan.practice.queries:
            return Progress(Stage.PRACTICE, query_index=progress.query_index + 1)
        return Progress(Stage.QUERY)
    if progress.query_index + 1 < plan.shown_per_trial and not event.is_sure:
        return Progress(Stage.QUERY, progress.trial_index, progress.query_index + 1)
    finished = progress.trial_index + 1
    if plan.items(AFTER_TRIAL):
        return Progress(Stage.QUESTIONNAIRE, trial_index=finished, query_index=AFTER_TRIAL)
    return _after_trial(plan, finished, event.at)


def _within_trial(plan: Plan, progress: Progress, event: Responded | Undone) -> Progress:
    if isinstance(event, Responded):
        return _after_response(plan, progress, event)
    just_before = 0 <= event.query_index == progress.query_index - 1
    if progress.stage is not Stage.QUERY or not just_before:
        raise _out_of_order(plan, progress)
    return Progress(Stage.QUERY, progress.trial_index, event.query_index)


def _after_questionnaire(plan: Plan, progress: Progress, event: Answered) -> Progress:
    if progress.stage is not Stage.QUESTIONNAIRE:
        raise _out_of_order(plan, progress)
    if progress.query_index == AFTER_TRIAL:
        return _after_trial(plan, progress.trial_index, event.at)
    return Progress(Stage.DEBRIEF, trial_index=progress.trial_index)


def _after_trial(plan: Plan, finished: int, at: datetime) -> Progress:
    if finished >= plan.trials:
        if plan.items(AT_THE_END):
            return Progress(Stage.QUESTIONNAIRE, trial_index=finished, query_index=AT_THE_END)
        return Progress(Stage.DEBRIEF, trial_index=finished)
    if plan.break_s > 0:
        ends_at = at + timedelta(seconds=plan.break_s)
        return Progress(Stage.BREAK, trial_index=finished, break_ends_at=ends_at)
    return _toward_trial(plan, finished)


def _toward_trial(plan: Plan, trial_index: int) -> Progress:
    """The progress before a trial: the familiarisation first, at the beginning of a block."""
    if plan.familiarises_before(trial_index):
        return Progress(Stage.FAMILIARISATION, trial_index=trial_index)
    return _past_the_videos(plan, trial_index)


def _past_the_videos(plan: Plan, trial_index: int) -> Progress:
    if trial_index == 0 and plan.practice.queries > 0:
        return Progress(Stage.PRACTICE)
    return Progress(Stage.QUERY, trial_index=trial_index)


def _out_of_order(plan: Plan, progress: Progress) -> OutOfOrder:
    if progress.stage is Stage.QUERY:
        at = position(plan, progress)
        return OutOfOrder(
            progress.stage,
            f"query {at['query']} of {at['queries']} in trial {at['trial']} of {at['trials']}"
            " has to be answered first",
        )
    return OutOfOrder(progress.stage, _TO_BE_DONE[progress.stage])


def _require_timezone(time: datetime) -> None:
    if time.tzinfo is None:
        raise ValueError(f"expected a time with its timezone, got {time.isoformat()}")
