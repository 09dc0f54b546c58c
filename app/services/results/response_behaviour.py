"""Results on response behaviour: skips, response times, sides, and consistency of repeats."""

from __future__ import annotations

from statistics import median
from typing import Final

from sqlalchemy.orm import Session

from app.services.export.table import Request, trials_of
from app.services.monitoring.check_outcomes import check_outcomes
from app.statistics.shares import share
from app.study.attention_checks import Kind

from .data import answers
from .result import Result, Row

_POOLED: Final = (
    "Answers of one person are not independent, so the interval over all of them is rather too"
    " narrow."
)


def skips(db: Session, request: Request) -> Result:
    """Share of skips by evaluator and trial, if the trial offers skips; without checks."""
    offered = {c.name for c in request.study.plan.conditions if c.skip is not None}
    counted: dict[tuple[str, ...], list[int]] = {}
    trials: dict[tuple[str, ...], int] = {}
    for answer in answers(db, request):
        if answer.condition in offered and not answer.is_check:
            key = (answer.participant, answer.session, answer.condition, str(answer.trial))
            trials[key] = answer.trial
            of_trial = counted.setdefault(key, [0, 0])
            of_trial[0] += answer.response == "skip"
            of_trial[1] += 1
    rows: list[Row] = [
        {
            "participant_id": participant,
            "session_id": session_id,
            "trial_index": trials[participant, session_id, condition, place],
            "condition": condition,
            "answers": number,
            "skips": skipped,
        }
        for (participant, session_id, condition, place), (skipped, number) in counted.items()
    ]
    if not rows:
        return Result((), "No answers yet where a skip is offered.")
    most, least = max(r["skips"] for r in rows), min(r["skips"] for r in rows)
    total, number = sum(r["skips"] for r in rows), sum(r["answers"] for r in rows)
    says = (
        f"{total} of {number} answers were skips ({total / number:.0%});"
        f" {least} to {most} in a trial."
    )
    return Result(rows, says, _left_out(request))


def response_times(db: Session, request: Request) -> Result:
    """Seconds from the start of both videos to the response, checks included."""
    counted = [answer for answer in answers(db, request) if answer.rt_ms is not None]
    rows: list[Row] = [
        {
            "session_id": answer.session,
            "trial_index": answer.trial,
            "condition": answer.condition,
            "query_index": answer.query,
            "response": answer.response,
            "rt_ms": answer.rt_ms,
        }
        for answer in counted
    ]
    if not rows:
        return Result((), "No answers with a time yet.")
    middle = median(row["rt_ms"] for row in rows) / 1000
    says = f"The median of {len(rows)} answers is {middle:.1f} s."
    checks = {answer.is_check for answer in counted}
    return Result(rows, f"{says} Answers to checks are among them." if True in checks else says)


def sides(db: Session, request: Request) -> Result:
    """Share of left choices by evaluator, with a 95 % interval; without checks."""
    counted: dict[tuple[str, str], list[int]] = {}
    for answer in answers(db, request):
        if answer.response != "skip" and not answer.is_check:
            of_session = counted.setdefault((answer.participant, answer.session), [0, 0])
            of_session[0] += answer.response == "left"
            of_session[1] += 1
    rows: list[Row] = []
    for (participant, session_id), (left, number) in counted.items():
        found = share(left, number)
        rows.append(
            {
                "participant_id": participant,
                "session_id": session_id,
                "choices": number,
                "left": left,
                "share_left": found.value,
                "low": found.low,
                "high": found.high,
            }
        )
    if not rows:
        return Result((), "No choices yet.")
    rows.sort(key=lambda row: row["share_left"])
    whole = share(sum(row["left"] for row in rows), sum(row["choices"] for row in rows))
    beyond = sum(not row["low"] <= 0.5 <= row["high"] for row in rows)
    says = (
        f"Of {whole.whole} choices {whole.value:.0%} were on the left [{whole.low:.0%},"
        f" {whole.high:.0%}]. {beyond} of {len(rows)} sessions leave one half outside their 95 %"
        " interval; chance alone makes that one in twenty."
    )
    return Result(rows, says, (*_left_out(request), _POOLED))


def repeats(db: Session, request: Request) -> Result:
    """Share of repeated pairs, with sides swapped, that were answered alike; by condition."""
    counted: dict[str, list[int]] = {}
    for outcome in check_outcomes(db, *trials_of(request)):
        if outcome.kind == Kind.REPEAT and outcome.passed is not None and outcome.trial_index >= 0:
            of_condition = counted.setdefault(outcome.condition, [0, 0])
            of_condition[0] += outcome.passed
            of_condition[1] += 1
    order = [condition.name for condition in request.study.plan.conditions]
    rows: list[Row] = []
    for condition in sorted(counted, key=lambda name: order.index(name) if name in order else 99):
        agreed, number = counted[condition]
        found = share(agreed, number)
        rows.append(
            {
                "condition": condition,
                "repeats": number,
                "agreed": agreed,
                "agreement": found.value,
                "low": found.low,
                "high": found.high,
            }
        )
    if not rows:
        why = "No pair has been shown again yet."
        none = "This study shows no pair a second time (checks: repeats in its plan)."
        return Result((), why if request.study.plan.repeats_per_trial else none)
    whole = share(sum(row["agreed"] for row in rows), sum(row["repeats"] for row in rows))
    says = (
        f"{whole.part} of {whole.whole} repeats were answered alike: {whole.value:.0%}"
        f" [{whole.low:.0%}, {whole.high:.0%}]."
    )
    return Result(rows, says, (_POOLED,))


def _left_out(request: Request) -> tuple[str, ...]:
    plan = request.study.plan
    has_checks = plan.shown_per_trial > plan.queries_per_trial
    return ("Checks (repeats and attention checks) are left out.",) if has_checks else ()
