"""A session goes through its stages in order, and through no others."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study import (
    Answered,
    BreakNotOver,
    Consented,
    Continued,
    Device,
    Event,
    OutOfOrder,
    Plan,
    Progress,
    ProtocolError,
    Responded,
    ScreenedOut,
    Stage,
    StaleConsent,
    Withdrew,
    advance,
    position,
)
from app.study.stages import FINAL_STAGES, Undone

NOON = datetime(2025, 3, 14, 12, 0, tzinfo=UTC)
AGREED = Consented("v1", "v1")


def later(seconds: float) -> datetime:
    return NOON + timedelta(seconds=seconds)


@pytest.fixture
def plan(build_plan: Callable[..., Plan]) -> Plan:
    """Two trials of three queries, a break of 60 s, familiarisation."""
    return build_plan(break_s=60, familiarisation={"videos": 2})


def went(plan: Plan, *events: Event) -> Progress:
    progress = Progress.start()
    for event in events:
        progress = advance(plan, progress, event)
    return progress


def first_trial(at: datetime = NOON) -> list[Event]:
    """All events up to the end of the first trial of three queries."""
    return [AGREED, Continued(at), Continued(at), *(Responded(index, at) for index in range(3))]


# One session, in order


def test_a_session_begins_at_the_consent() -> None:
    assert Progress.start() == Progress(Stage.CONSENT, 0, 0, None)


def test_a_whole_session_goes_through_every_stage_in_order(plan: Plan) -> None:
    events = [
        *first_trial(),
        Continued(later(60)),
        *(Responded(index, later(90)) for index in range(3)),
        Continued(later(100)),
    ]
    progress = Progress.start()
    seen = [progress.stage]
    for event in events:
        progress = advance(plan, progress, event)
        seen.append(progress.stage)
    query, trial = Stage.QUERY, [Stage.QUERY] * 2
    assert seen == [
        Stage.CONSENT,
        Stage.INSTRUCTIONS,
        Stage.FAMILIARISATION,
        query,
        *trial,
        Stage.BREAK,
        query,
        *trial,
        Stage.DEBRIEF,
        Stage.COMPLETED,
    ]


def test_without_videos_the_instructions_lead_to_the_first_query(
    build_plan: Callable[..., Plan],
) -> None:
    plan = build_plan(familiarisation={"videos": 0})
    assert went(plan, AGREED, Continued(NOON)) == Progress(Stage.QUERY)


def test_without_a_break_the_next_trial_begins_at_once(build_plan: Callable[..., Plan]) -> None:
    plan = build_plan(break_s=0, familiarisation={"videos": 1})
    assert went(plan, *first_trial()) == Progress(Stage.QUERY, trial_index=1)


def test_no_break_follows_the_last_trial(build_plan: Callable[..., Plan]) -> None:
    only = [{"name": "a", "method": "knockout", "environment": "kitchen"}]
    plan = build_plan(conditions=only, break_s=60, familiarisation={"videos": 1})
    assert went(plan, *first_trial()) == Progress(Stage.DEBRIEF, trial_index=1)


def test_the_response_just_before_can_be_taken_back_within_its_trial(plan: Plan) -> None:
    second = went(plan, AGREED, Continued(NOON), Continued(NOON), Responded(0, NOON))
    assert second == Progress(Stage.QUERY, query_index=1)
    first = advance(plan, second, Undone(0))
    assert first == Progress(Stage.QUERY)
    for progress, undone in ((first, Undone(-1)), (second, Undone(1)), (first, Undone(0))):
        with pytest.raises(OutOfOrder):
            advance(plan, progress, undone)
    with pytest.raises(OutOfOrder):
        advance(plan, went(plan, *first_trial()), Undone(2))


# Consent


def test_consent_to_a_text_that_has_changed_is_refused_with_the_current_version(
    plan: Plan,
) -> None:
    with pytest.raises(StaleConsent, match="expected version v2, got v1") as caught:
        went(plan, Consented("v1", current_version="v2"))
    assert caught.value.current == "v2"


def test_whoever_leaves_at_the_consent_has_declined(plan: Plan) -> None:
    assert went(plan, Withdrew()) == Progress(Stage.DECLINED)


# The break


def test_a_break_ends_its_length_after_the_last_response(plan: Plan) -> None:
    assert went(plan, *first_trial(NOON)) == Progress(
        Stage.BREAK, trial_index=1, break_ends_at=later(60)
    )


@pytest.mark.parametrize(("waited", "left"), [(0, 60), (0.5, 60), (59.001, 1), (-5, 60)])
def test_a_break_cannot_be_cut_short(plan: Plan, waited: float, left: int) -> None:
    with pytest.raises(BreakNotOver, match=f"{left} s more") as caught:
        went(plan, *first_trial(), Continued(later(waited)))
    assert caught.value.seconds_left == left


@pytest.mark.parametrize("back", [7200, 61])
def test_a_clock_that_was_set_back_keeps_nobody_in_a_break(plan: Plan, back: float) -> None:
    progress = went(plan, *first_trial(), Continued(later(-back)))
    assert progress == Progress(Stage.QUERY, trial_index=1)


@pytest.mark.parametrize("waited", [60, 61, 86_400])
def test_a_break_can_be_left_when_it_is_over_and_need_not_be_left_at_once(
    plan: Plan, waited: float
) -> None:
    progress = went(plan, *first_trial(), Continued(later(waited)))
    assert progress == Progress(Stage.QUERY, trial_index=1)


def test_a_break_is_as_long_in_another_timezone(plan: Plan) -> None:
    over = later(60).astimezone(timezone(timedelta(hours=9)))
    assert went(plan, *first_trial(), Continued(over)).stage is Stage.QUERY


@pytest.mark.parametrize("make", [Continued, lambda at: Responded(0, at)])
def test_a_time_without_a_timezone_is_refused(make: Callable[[datetime], Event]) -> None:
    with pytest.raises(ValueError, match="expected a time with its timezone"):
        make(NOON.replace(tzinfo=None))


# Out of order


@pytest.mark.parametrize("index", [0, 2, -1])
def test_a_response_to_another_query_than_the_open_one_is_refused(plan: Plan, index: int) -> None:
    before: list[Event] = [AGREED, Continued(NOON), Continued(NOON), Responded(0, NOON)]
    with pytest.raises(OutOfOrder, match="query 2 of 3 in trial 1 of 2 has to be answered"):
        went(plan, *before, Responded(index, NOON))


@pytest.mark.parametrize(
    ("events", "too_early", "expected"),
    [
        ([], Continued(NOON), "consent"),
        ([], Responded(0, NOON), "consent"),
        ([AGREED], AGREED, "instructions"),
        ([AGREED], Responded(0, NOON), "instructions"),
        ([AGREED, Continued(NOON)], Responded(0, NOON), "familiarisation"),
        ([AGREED, Continued(NOON), Continued(NOON)], Continued(NOON), "query 1 of 3 in trial 1"),
        ([AGREED, Continued(NOON), Continued(NOON)], AGREED, "query 1 of 3 in trial 1"),
        (first_trial(), Responded(0, NOON), "break"),
        ([Withdrew()], AGREED, "declined"),
        ([AGREED, Withdrew()], Continued(NOON), "ended"),
        ([AGREED, Withdrew()], Withdrew(), "ended"),
    ],
)
def test_what_is_out_of_order_is_refused_with_what_is_to_be_done(
    plan: Plan, events: list[Event], too_early: Event, expected: str
) -> None:
    stage = went(plan, *events).stage
    with pytest.raises(OutOfOrder, match=expected) as caught:
        went(plan, *events, too_early)
    assert caught.value.stage is stage
    assert f"in stage {stage}" in str(caught.value)


# Progress in numbers


def test_progress_is_counted_from_one_for_people(plan: Plan) -> None:
    def numbers(*events: Event) -> tuple[int, int, int, int]:
        at = position(plan, went(plan, *events))
        return at["trial"], at["trials"], at["query"], at["queries"]

    second_trial = [*first_trial(), Continued(later(60))]
    to_the_end: list[Event] = [*second_trial, *(Responded(i, NOON) for i in range(3))]
    assert numbers() == (0, 2, 0, 3)
    assert numbers(AGREED, Continued(NOON)) == (0, 2, 0, 3)
    assert numbers(*first_trial()[:3]) == (1, 2, 1, 3)
    assert numbers(*first_trial()[:5]) == (1, 2, 3, 3)
    assert numbers(*first_trial()) == (1, 2, 3, 3)
    assert numbers(*second_trial) == (2, 2, 1, 3)
    assert numbers(*to_the_end) == (2, 2, 3, 3)
    assert numbers(*to_the_end, Continued(NOON)) == (2, 2, 3, 3)
    assert numbers(*second_trial, Responded(0, NOON), Withdrew()) == (1, 2, 3, 3)


@pytest.mark.parametrize(
    "fields",
    [
        {"stage": Stage.QUERY, "trial_index": -1},
        {"stage": Stage.QUERY, "query_index": -1},
        {"stage": Stage.INSTRUCTIONS, "query_index": 1},
        {"stage": Stage.INSTRUCTIONS, "trial_index": 1},
        {"stage": Stage.DEBRIEF, "trial_index": 0},
        {"stage": Stage.BREAK, "trial_index": 1},
        {"stage": Stage.BREAK, "trial_index": 0, "break_ends_at": NOON},
        {"stage": Stage.BREAK, "trial_index": 1, "break_ends_at": NOON.replace(tzinfo=None)},
        {"stage": Stage.QUERY, "break_ends_at": NOON},
    ],
)
def test_progress_that_cannot_be_is_never_born(fields: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        Progress(**fields)  # type: ignore[arg-type]


# Any events in any order

times = st.integers(min_value=-100, max_value=1000).map(later)
events_at_random = st.lists(
    st.one_of(
        st.builds(Consented, st.sampled_from(["v1", "v2"]), st.just("v1")),
        st.builds(Answered, times),
        st.builds(Continued, times),
        st.builds(Responded, st.integers(-1, 4), times),
        st.builds(Undone, st.integers(-1, 4)),
        st.builds(ScreenedOut),
        st.builds(Withdrew),
    ),
    max_size=40,
)
ITEM = {"name": "effort", "type": "likert", "label": "How hard was it?"}
shapes = st.fixed_dictionaries(
    {
        "break_s": st.sampled_from([0, 60]),
        "queries_per_trial": st.integers(1, 4),
        "trials_per_condition": st.integers(1, 2),
        "familiarisation": st.sampled_from([{"videos": 0}, {"videos": 3}]),
        "device_check": st.sampled_from([None, {"min_width_px": 600}]),
        "practice": st.sampled_from([{}, {"queries": 2}]),
        "questionnaires": st.sampled_from(
            [{}, {"end": [ITEM]}, {"after_trial": [ITEM], "end": [ITEM]}]
        ),
    }
)


def assert_possible(plan: Plan, progress: Progress) -> None:
    if progress.stage is Stage.QUESTIONNAIRE:
        assert plan.items(progress.query_index)
    elif progress.stage is Stage.PRACTICE:
        assert 0 <= progress.query_index < plan.practice.queries
    else:
        assert 0 <= progress.query_index < plan.queries_per_trial
    finished = progress.trial_index
    if progress.stage in (Stage.QUERY, Stage.BREAK):
        assert finished < plan.trials
    if progress.stage in (Stage.DEBRIEF, Stage.COMPLETED):
        assert finished == plan.trials
    if progress.stage is Stage.BREAK:
        assert plan.break_s > 0
    if progress.stage is Stage.FAMILIARISATION:
        assert plan.familiarisation.videos > 0
    at = position(plan, progress)
    assert 0 <= at["trial"] <= at["trials"]
    assert 0 <= at["query"] <= at["queries"]


@given(shape=shapes, events=events_at_random)
def test_no_events_in_whatever_order_leave_an_impossible_state(
    build_plan: Callable[..., Plan], shape: dict[str, object], events: list[Event]
) -> None:
    plan = build_plan(**shape)
    progress = Progress.start()
    for event in events:
        was = progress
        try:
            progress = advance(plan, progress, event)
        except ProtocolError:
            continue
        assert was.stage not in FINAL_STAGES
        assert progress != was
        assert_possible(plan, progress)


@given(shape=shapes, data=st.data())
def test_a_session_that_goes_on_answers_every_query_once_and_completes(
    build_plan: Callable[..., Plan], shape: dict[str, object], data: st.DataObject
) -> None:
    plan = build_plan(**shape)
    progress, now, answered = Progress.start(), NOON, []
    while progress.stage not in FINAL_STAGES:
        now += timedelta(seconds=data.draw(st.integers(1, 200)))
        if progress.stage is Stage.CONSENT:
            progress = advance(plan, progress, AGREED)
        elif progress.stage is Stage.DEVICE_CHECK:
            device = Device(width_px=600, played=True)
            progress = advance(plan, progress, Continued(now, device=device))
        elif progress.stage is Stage.PRACTICE:
            progress = advance(plan, progress, Responded(progress.query_index, now))
        elif progress.stage is Stage.QUERY:
            answered.append((progress.trial_index, progress.query_index))
            progress = advance(plan, progress, Responded(progress.query_index, now))
        elif progress.stage is Stage.QUESTIONNAIRE:
            progress = advance(plan, progress, Answered(now))
        else:
            try:
                progress = advance(plan, progress, Continued(now))
            except BreakNotOver as error:
                now += timedelta(seconds=error.seconds_left)
                progress = advance(plan, progress, Continued(now))
    assert progress.stage is Stage.COMPLETED
    queries = range(plan.queries_per_trial)
    assert answered == [(trial, query) for trial in range(plan.trials) for query in queries]


@given(shape=shapes, events=events_at_random)
def test_whoever_has_not_ended_can_always_leave(
    build_plan: Callable[..., Plan], shape: dict[str, object], events: list[Event]
) -> None:
    plan = build_plan(**shape)
    progress = Progress.start()
    for event in events:
        try:
            progress = advance(plan, progress, event)
        except ProtocolError:
            continue
        if progress.stage not in FINAL_STAGES:
            assert advance(plan, progress, Withdrew()).stage in FINAL_STAGES


def test_there_is_no_event_that_the_tests_leave_out() -> None:
    assert set(get_args(Event)) == {
        Consented,
        Continued,
        Responded,
        Undone,
        Answered,
        ScreenedOut,
        Withdrew,
    }
