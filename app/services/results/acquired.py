"""Results on acquired candidates: their position in W, and their mean scores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, groupby
from typing import Final

from sqlalchemy.orm import Session

from app.services.export.table import Request, points
from app.services.studies.candidate_scores import mean_scores
from app.statistics.comparisons import SampleError, compare, p_value
from app.study.plan import Plan

from .data import AcquiredRow, acquired_rows, answers
from .result import Result, Row

#: Numbers of answers at which the paper evaluates the acquired candidates (Fig. 17), besides the
#: end of each trial.
AFTER_ANSWERS: Final = (10, 20, 30)


def on_w(db: Session, request: Request) -> Result:
    """The candidate that each finished trial ended with."""
    by_candidate = points(db, request)
    of_score = mean_scores(db, request.study.id)
    names = [parameter.name for parameter in request.study.plan.parameters]
    last = {(at.session, at.trial): at for at in acquired_rows(db, request) if at.finished}
    rows: list[Row] = [
        {
            "session_id": at.session,
            "participant_id": at.participant,
            "trial_index": at.trial,
            "condition": at.condition,
            "environment": at.environment,
            "candidate": at.candidate,
            **dict(zip(names, by_candidate[at.environment, at.candidate], strict=True)),
            "score": of_score.get((at.environment, at.candidate)),
        }
        for at in last.values()
    ]
    if not rows:
        return Result((), "No trial is finished yet.")
    different = len({(row["environment"], row["candidate"]) for row in rows})
    says = f"{len(rows)} finished trials ended with {different} different candidates."
    ground = of_score or _shown(db, request)
    return Result(
        rows,
        says,
        extra={
            "points": by_candidate,
            "ground": ground,
            "ground_title": "mean score" if of_score else "times shown",
        },
    )


def _shown(db: Session, request: Request) -> dict[tuple[str, int], float]:
    shown: dict[tuple[str, int], float] = {}
    for answer in answers(db, request):
        for candidate in (answer.left, answer.right):
            key = (answer.environment, candidate)
            shown[key] = shown.get(key, 0.0) + 1.0
    return shown


def scores_acquired(db: Session, request: Request) -> Result:
    """Mean score of the acquired candidate after 10, 20, 30 and all answers, with t-tests.

    Only answers that the method learnt from are counted.
    """
    of_score = mean_scores(db, request.study.id)
    if not of_score:
        return Result((), "The recordings of this study have no scores.")
    plan = request.study.plan
    most = plan.learned_per_trial
    looks = sorted({*(number for number in AFTER_ANSWERS if number < most), most})
    rows: list[Row] = [
        {
            "session_id": at.session,
            "participant_id": at.participant,
            "trial_index": at.trial,
            "condition": at.condition,
            "environment": at.environment,
            "answers": number,
            "candidate": at.candidate,
            "score": of_score[at.environment, at.candidate],
        }
        for number, at in _looked_at(acquired_rows(db, request), looks)
        if (at.environment, at.candidate) in of_score
    ]
    if not rows:
        return Result((), f"No trial has {looks[0]} answers yet.")
    tests, notes = _tests(rows, [condition.name for condition in plan.conditions])
    last = max(row["answers"] for row in rows)
    means = "; ".join(
        f"{condition} {sum(found) / len(found):.1f} ({len(found)} trials)"
        for condition, found in _by_condition(rows, last).items()
    )
    says = f"Mean score after {last} answers: {means}. {_counted(plan)}"
    return Result(rows, says, notes, {"tests": tests})


def _looked_at(
    held: Iterable[AcquiredRow], looks: Sequence[int]
) -> Iterator[tuple[int, AcquiredRow]]:
    """For each number in `looks`, the acquired candidate of each trial after that many answers.

    A finished trial with fewer answers is evaluated at its end.
    """
    for _, of_trial in groupby(held, key=lambda at: (at.session, at.trial)):
        by_number = {at.learned: at for at in of_trial}
        end = by_number[max(by_number)]
        for number in looks:
            if number in by_number:
                yield number, by_number[number]
            elif end.finished:
                yield number, end


def _counted(plan: Plan) -> str:
    """A sentence on which answers are counted."""
    if plan.shown_per_trial == plan.queries_per_trial:
        return "Skips count as answers."
    if plan.checks.in_model:
        return "Skips and checks count as answers: the model learns from them."
    return (
        "Counted are answers that the method learned from, skips included: checks (repeats and"
        " attention checks) are not."
    )


def _by_condition(rows: list[Row], number: int) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["answers"] == number:
            found.setdefault(row["condition"], []).append(row["score"])
    return found


def _tests(rows: list[Row], order: list[str]) -> tuple[list[Row], tuple[str, ...]]:
    """The paper's two-sample t-test for every two conditions of one environment."""
    samples: dict[tuple[str, int, str], list[float]] = {}
    for row in rows:
        key = (row["environment"], row["answers"], row["condition"])
        samples.setdefault(key, []).append(row["score"])
    tests: list[Row] = []
    notes: list[str] = []
    for environment, number in sorted({key[:2] for key in samples}):
        present = [name for name in order if (environment, number, name) in samples]
        for first, second in combinations(present, 2):
            one, other = (samples[environment, number, name] for name in (first, second))
            try:
                found = compare(one, other)
            except SampleError:
                continue
            tests.append(
                {
                    "panel": environment,
                    "group": number,
                    "first": first,
                    "second": second,
                    "stars": found.stars,
                    "difference": found.difference,
                    "low": found.low,
                    "high": found.high,
                    "t": found.t,
                    "freedom": len(one) + len(other) - 2,
                    "p": found.p,
                    "effect": found.effect,
                }
            )
            notes.append(
                f"{environment}, {number} answers: {first} against {second}: difference"
                f" {found.difference:+.1f} [{found.low:+.1f}, {found.high:+.1f}],"
                f" p {p_value(found.p)}, g = {found.effect:+.2f}"
                f" ({len(one)} and {len(other)} trials)"
            )
    return tests, tuple(notes)
