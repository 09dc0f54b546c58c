"""The model of a study's `study.yaml`, and the hash that freezes it.

Every field's description says what is expected: error messages quote it, so that rule and message
cannot diverge. Rules between fields are in `plan_validation`, which also works on a plan with
other faults.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    JsonValue,
    StrictInt,
    StrictStr,
    StringConstraints,
    model_validator,
)
from pydantic_core import PydanticCustomError

from .analysis import Analysis
from .attention_checks import Checks, number
from .environments import Environment
from .plan_model import ONE_OR_MORE_TEXTS, LocalText, Part, absent
from .plan_validation import METHODS, inconsistencies
from .query_settings import QueryPage, Skip
from .questionnaire import Item, Questionnaires
from .recordings import RecordingRow
from .recruitment import Recruitment
from .retention import Retention
from .reward import Reward
from .search_space import MOST_CONSTRAINTS, Parameter, SearchSpace, space_between
from .stage_settings import DeviceCheck, Familiarisation, Practice, Resume
from .stopping import USUAL_WITHIN, Stop

# These name folders as well, so they hold nothing that leads elsewhere.
LANGUAGE_PATTERN = r"^[a-z]{2,3}(-[A-Za-z0-9]{2,8})*$"


def _require_method(name: str) -> str:
    if all(name != method.name for method in METHODS):
        raise ValueError("not a method")
    return name


Language = Annotated[StrictStr, StringConstraints(pattern=LANGUAGE_PATTERN)]
EnvironmentName = Annotated[StrictStr, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]{0,59}$")]
MethodName = Annotated[StrictStr, AfterValidator(_require_method)]


class Condition(Part):
    """What a trial is run under: a method with its settings, in an environment."""

    name: StrictStr = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,59}$",
        description="a name of up to 60 letters, digits, spaces, and . _ -",
    )
    method: MethodName = Field(description="one of " + ", ".join(method.name for method in METHODS))
    environment: StrictStr = Field(description="the name of one of the environments")
    skip: Skip | None = Field(default=None, description="a mapping such as {label: ...}")
    settings: dict[str, JsonValue] = Field(
        default_factory=dict,
        description="a mapping of settings for the method such as {preset: paper-env1}",
    )
    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    model: Literal["own", "shared"] = Field(
        default="own",
        exclude_if=lambda model: model == "own",
        description="own or shared: whether the answers of all people teach one model",
    )
    target: Literal["population", "person"] | None = Field(
        default=None,
        alias="for",
        exclude_if=absent,
        description="population or person: whose best a shared model looks for",
    )

    # "for" is a word of Python's own.
    model_config = ConfigDict(serialize_by_alias=True)

    @property
    def is_shared(self) -> bool:
        """Whether all people under this condition teach one model."""
        return self.model == "shared"

    @property
    def finds(self) -> Literal["population", "person"]:
        """Whose best candidate a shared model looks for."""
        return self.target or "population"

    @property
    def optimizer_settings(self) -> dict[str, JsonValue]:
        """The settings of the optimiser: the condition's own, and what its skip means."""
        if self.skip is None or self.skip.means is None:
            return self.settings
        return {"threshold_skip_means": self.skip.means, **self.settings}


class Plan(Part):
    """A whole study as written in its `study.yaml`. The upper limits only catch typing errors."""

    version: Literal[1] = Field(description="1, the version of this file's form")
    slug: StrictStr = Field(
        pattern=r"^[a-z0-9][a-z0-9-]{0,59}$",
        description="1 to 60 lower-case letters, digits and hyphens such as my-first-study",
    )
    title: LocalText = Field(description=ONE_OR_MORE_TEXTS)
    languages: tuple[Language, ...] = Field(
        min_length=1, description="a list of language codes such as [en, ja]"
    )
    parameters: tuple[Parameter, ...] = Field(
        min_length=1, description="a list of parameters such as {name: speed, unit: m/s}"
    )
    # Left out of a plan's data where not used, so that the hashes of earlier plans stay valid.
    constraints: tuple[StrictStr, ...] = Field(
        default=(),
        max_length=MOST_CONSTRAINTS,
        exclude_if=lambda constraints: not constraints,
        description="a list of inequalities between parameters such as [w0 >= w1]",
    )
    environments: dict[EnvironmentName, Environment] = Field(
        min_length=1,
        description="a mapping of lower-case names to environments"
        " such as {kitchen: {source: recordings.csv}}",
    )
    conditions: tuple[Condition, ...] = Field(
        min_length=1,
        description="a list of conditions, each with its name, method and environment",
    )
    trials_per_condition: StrictInt = Field(
        default=1, ge=1, le=100, description="a whole number from 1 to 100"
    )
    queries_per_trial: StrictInt = Field(ge=1, le=1000, description="a whole number from 1 to 1000")
    order: Literal["counterbalanced", "fixed"] = Field(
        default="counterbalanced", description="counterbalanced or fixed"
    )
    # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
    stop: Stop | None = Field(
        default=None,
        exclude_if=absent,
        description="a mapping such as {sure: 0.95, within: 0.1}",
    )
    break_s: StrictInt = Field(
        default=120, ge=0, le=86_400, description="whole seconds from 0 (no break) to 86400"
    )
    device_check: DeviceCheck | None = Field(
        default=None, description="a mapping such as {test_clip: true, min_width_px: 600}"
    )
    familiarisation: Familiarisation = Field(
        default=Familiarisation(), description="a mapping such as {videos: 10, required: 0}"
    )
    practice: Practice = Field(default=Practice(), description="a mapping such as {queries: 3}")
    blocks: Literal["session", "environment"] = Field(
        default="session",
        description="session, or environment to keep the trials of each environment together",
    )
    checks: Checks = Field(
        default=Checks(), description="a mapping such as {repeats: 0.1, attention: 0.1}"
    )
    query: QueryPage = Field(
        default=QueryPage(), description='a mapping such as {question: "Which is safer?"}'
    )
    questionnaires: Questionnaires = Field(
        default=Questionnaires(),
        description="a mapping such as {after_trial: [{name: effort, type: likert, label: ...}]}",
    )
    recruitment: Recruitment = Field(
        default=Recruitment(), description="a mapping such as {platform: prolific, codes: ...}"
    )
    reward: Reward | None = Field(
        default=None, description="a mapping such as {amount: 4.5, currency: EUR}"
    )
    places: StrictInt | None = Field(
        default=None, ge=1, le=1_000_000, description="a whole number of people of at least 1"
    )
    lease_minutes: StrictInt = Field(
        default=60, ge=5, le=100_000, description="a whole number of minutes of at least 5"
    )
    resume: Resume = Field(
        default=Resume(), description="a mapping such as {policy: restart, max_age_hours: 24}"
    )
    session_expires_after_days: StrictInt = Field(
        default=14, ge=1, le=3650, description="a whole number of days from 1 to 3650"
    )
    retention: Retention = Field(
        default=Retention(),
        description="a mapping such as {identity_days: 90, everything_days: 3650}",
    )
    analysis: Analysis = Field(
        default=Analysis(),
        # Left out of a plan's data where not given, so that the hashes of earlier plans stay valid.
        exclude_if=lambda analysis: analysis == Analysis(),
        description="a mapping such as {primary: [pbpo, pbpo-no-skip]}",
    )
    contact: StrictStr | None = Field(
        default=None, min_length=1, description="a text that says whom to ask"
    )

    @model_validator(mode="after")
    def _hold_together(self) -> Self:
        found = inconsistencies(self.model_dump(mode="json"))
        if found:
            message = "; ".join(str(inconsistency) for inconsistency in found)
            raise PydanticCustomError("inconsistent", "{message}", {"message": message})
        return self

    @property
    def has_ranges(self) -> bool:
        """Whether candidates are the points of a space and not of a list; all of its machines."""
        return self.parameters[0].min is not None

    @property
    def space(self) -> SearchSpace | None:
        """The search space given by the parameters' ranges; None if candidates are listed."""
        return space_between(self.parameters, self.constraints) if self.has_ranges else None

    @property
    def trials(self) -> int:
        """How many trials one session has."""
        return len(self.conditions) * self.trials_per_condition

    @property
    def repeats_per_trial(self) -> int:
        """How many earlier queries a trial shows again."""
        return number(self.checks.repeats, self.queries_per_trial)

    @property
    def attention_per_trial(self) -> int:
        """How many attention checks a trial has."""
        return number(self.checks.attention, self.queries_per_trial)

    @property
    def shown_per_trial(self) -> int:
        """How many pairs a trial shows: its queries and the checks between them."""
        return self.queries_per_trial + self.repeats_per_trial + self.attention_per_trial

    @property
    def learned_per_trial(self) -> int:
        """The number of responses in a complete trial from which its model learns."""
        return self.shown_per_trial if self.checks.in_model else self.queries_per_trial

    @property
    def within(self) -> float:
        """The share of a trial's range that makes no difference to how sure it is."""
        return USUAL_WITHIN if self.stop is None else self.stop.within

    @property
    def used_environments(self) -> tuple[str, ...]:
        """The environments that conditions name, in the order of the conditions."""
        return tuple(dict.fromkeys(condition.environment for condition in self.conditions))

    @property
    def trials_per_block(self) -> int:
        """The number of consecutive trials that share one familiarisation."""
        blocks = len(self.used_environments) if self.blocks == "environment" else 1
        return self.trials // blocks

    def familiarises_before(self, trial_index: int) -> bool:
        """Whether videos are watched before this trial."""
        return self.familiarisation.videos > 0 and trial_index % self.trials_per_block == 0

    def items(self, page: int) -> tuple[Item, ...]:
        """The questionnaire's items: page 0 comes after a trial, page 1 at the end."""
        return (self.questionnaires.after_trial, self.questionnaires.end)[page]

    @property
    def default_language(self) -> str:
        """The first language of the study."""
        return self.languages[0]

    def environment_of(self, condition: Condition) -> Environment:
        """The environment of a condition."""
        return self.environments[condition.environment]

    def text(self, text: str | Mapping[str, str], language: str) -> str:
        """The text in this language, or else in the study's first language."""
        if isinstance(text, str):
            return text
        fallback = text.get(self.default_language) or next(iter(text.values()))
        return text.get(language, fallback)


def plan_hash(
    plan: Plan,
    texts: Mapping[str, Mapping[str, str]],
    recordings: Sequence[RecordingRow] = (),
) -> str:
    """SHA-256 over all that an evaluator or the optimiser depends on, as 64 hex digits.

    Canonical JSON with sorted keys, so comments and the order of keys do not count. The order of
    recordings does: it numbers the candidates, and the optimiser draws by number.
    """
    frozen: dict[str, Any] = {
        "plan": plan.model_dump(mode="json"),
        "texts": {language: dict(named) for language, named in texts.items()},
        "recordings": _digest([asdict(row) for row in recordings]),
    }
    return _digest(frozen)


def _digest(value: object) -> str:
    canonical = json.dumps(
        value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return hashlib.sha256(canonical.encode("utf-8")).hexdigest()
