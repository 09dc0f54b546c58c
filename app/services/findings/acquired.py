"""What was acquired: where on W it lies, and how good it is by the recordings' scores."""

from __future__ import annotations

from itertools import combinations
from typing import Final

from sqlalchemy.orm import Session

from app.services.export.columns import Request, points
from app.services.scores import mean_scores
from app.statistics.comparisons import SampleError, compare, p_value

from .found import Found, Row
from .reading import answers, holdings

#: Answers after which the paper looks at what people's trials had acquired (Fig. 17).
AFTER_ANSWERS: Final = (10, 20, 30)


def on_w(session: Session, request: Request) -> Found:
    """The candidate that each finished trial ended with."""
    by_candidate = points(session, request)
    of_score = mean_scores(session, request.study.id)
    names = [parameter.name for parameter in request.study.plan.parameters]
    last = {(at.session, at.trial): at for at in holdings(session, request) if at.finished}
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
        return Found((), "No trial is finished yet.")
    different = len({(row["environment"], row["candidate"]) for row in rows})
    says = f"{len(rows)} finished trials ended with {different} different candidates."
    ground = of_score or _shown(session, request)
    return Found(
        rows,
        says,
        extra={
            "points": by_candidate,
            "ground": ground,
            "ground_title": "mean score" if of_score else "times shown",
        },
    )


def _shown(session: Session, request: Request) -> dict[tuple[str, int], float]:
    shown: dict[tuple[str, int], float] = {}
    for answer in answers(session, request):
        for candidate in (answer.left, answer.right):
            key = (answer.environment, candidate)
            shown[key] = shown.get(key, 0.0) + 1.0
    return shown


def scores_acquired(session: Session, request: Request) -> Found:
    """The mean score of what each trial had acquired after 10, 20 and 30 answers, with tests."""
    of_score = mean_scores(session, request.study.id)
    if not of_score:
        return Found((), "The recordings of this study have no scores.")
    plan = request.study.plan
    groups = [number for number in AFTER_ANSWERS if number <= plan.shown_per_trial]
    groups = groups or [plan.shown_per_trial]
    rows: list[Row] = [
        {
            "session_id": at.session,
            "participant_id": at.participant,
            "trial_index": at.trial,
            "condition": at.condition,
            "environment": at.environment,
            "answers": at.query + 1,
            "candidate": at.candidate,
            "score": of_score[at.environment, at.candidate],
        }
        for at in holdings(session, request)
        if at.query + 1 in groups and (at.environment, at.candidate) in of_score
    ]
    if not rows:
        return Found((), f"No trial has {groups[0]} answers yet.")
    tests, notes = _tests(rows, [condition.name for condition in plan.conditions])
    means = "; ".join(
        f"{condition} {sum(found) / len(found):.1f} ({len(found)} trials)"
        for condition, found in _by_condition(rows, max(row["answers"] for row in rows)).items()
    )
    says = f"Mean score after {max(row['answers'] for row in rows)} answers: {means}."
    return Found(rows, says, notes, {"tests": tests})


def _by_condition(rows: list[Row], number: int) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for row in rows:
        if row["answers"] == number:
            found.setdefault(row["condition"], []).append(row["score"])
    return found


def _tests(rows: list[Row], order: list[str]) -> tuple[list[Row], tuple[str, ...]]:
    """Every two conditions of one environment, by the paper's two-sample t-test."""
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
