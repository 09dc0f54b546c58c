"""The mean scores of acquired candidates at several looks, and the tests between conditions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from app.services.export.table import Request
from app.services.studies.candidate_scores import mean_scores
from app.statistics.comparisons import Comparison, SampleError, compare, p_value, stars_of
from app.statistics.paired import PairedComparison, compare_paired, holm
from app.study.plan import Plan
from app.study.planned_tests import comparisons, is_primary, looks

from .data import AcquiredRow, acquired_rows
from .result import Result, Row, Summary

#: Environment, number of answers, condition.
Cell = tuple[str, int, str]


def scores_acquired(db: Session, request: Request) -> Result:
    """Mean score of the acquired candidate after 10, 20, 30 and all answers, with t-tests.

    Only answers that the method learnt from are counted.
    """
    of_score = mean_scores(db, request.study.id)
    if not of_score:
        return Result((), "The recordings of this study have no scores.")
    plan = request.study.plan
    at_answers = looks(plan)
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
        for number, at in _looked_at(acquired_rows(db, request), at_answers)
        if (at.environment, at.candidate) in of_score
    ]
    if not rows:
        return Result((), f"No trial has {at_answers[0]} answers yet.")
    rows.sort(key=lambda row: row["answers"])
    cells = _cells(rows, plan)
    tests = _tests(rows, plan)
    unit = score_unit(plan)
    last = max(row["answers"] for row in rows)
    means = "; ".join(
        f"{condition} {np.mean(cells[cell]):.1f} ({len(cells[cell])} trials)"
        for cell in cells
        for condition in [cell[2]]
        if cell[1] == last
    )
    in_unit = f" in {unit}" if unit else ""
    says = f"Mean score{in_unit} after {last} answers: {means}. {_counted(plan)}"
    return Result(
        rows,
        says,
        _notes(tests, plan),
        (_described(rows, cells, unit), *_tested(tests)),
        {"tests": tests, "unit": unit},
    )


def score_unit(plan: Plan) -> str | None:
    """The unit of the scores: the plan's, or grams for the simulated crane."""
    if plan.analysis.score_unit is not None:
        return plan.analysis.score_unit
    used = [plan.environments[name] for name in plan.used_environments]
    return "g" if all(environment.is_crane for environment in used) else None


def _looked_at(
    held: Iterable[AcquiredRow], at_answers: Sequence[int]
) -> Iterator[tuple[int, AcquiredRow]]:
    """For each number of answers, the acquired candidate of each trial after that many answers.

    A finished trial with fewer answers is evaluated at its end.
    """
    for _, of_trial in groupby(held, key=lambda at: (at.session, at.trial)):
        by_number = {at.learned: at for at in of_trial}
        end = by_number[max(by_number)]
        for number in at_answers:
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


def _cells(rows: Sequence[Row], plan: Plan) -> dict[Cell, list[float]]:
    """The scores of each environment, look and condition, conditions in the order of the plan."""
    cells: dict[Cell, list[float]] = {}
    for row in rows:
        cells.setdefault((row["environment"], row["answers"], row["condition"]), []).append(
            row["score"]
        )
    order = [condition.name for condition in plan.conditions]

    def place(cell: Cell) -> tuple[str, int, int, str]:
        known = order.index(cell[2]) if cell[2] in order else len(order)
        return (cell[0], cell[1], known, cell[2])

    return {cell: cells[cell] for cell in sorted(cells, key=place)}


def _by_person(rows: Sequence[Row]) -> dict[Cell, dict[str, float]]:
    """The mean score over each person's trials of an environment, look and condition."""
    found: dict[Cell, dict[str, list[float]]] = {}
    for row in rows:
        cell = (row["environment"], row["answers"], row["condition"])
        found.setdefault(cell, {}).setdefault(row["participant_id"], []).append(row["score"])
    return {
        cell: {person: float(np.mean(scores)) for person, scores in people.items()}
        for cell, people in found.items()
    }


def _tests(rows: Sequence[Row], plan: Plan) -> list[Row]:
    """The tests of every two conditions of one environment at every look.

    Unpaired over trials as in the paper, and paired over people who have both conditions. Holm's
    method adjusts the paired p-values together, except that of the primary comparison. `stars`
    follow the adjusted value.
    """
    cells, people = _cells(rows, plan), _by_person(rows)
    tests: list[dict[str, Any]] = []
    for environment, number in sorted({cell[:2] for cell in cells}):
        for first, second in comparisons(plan):
            one, other = (environment, number, first), (environment, number, second)
            if one not in cells or other not in cells:
                continue
            both = [person for person in people[one] if person in people[other]]
            unpaired = _or_none(compare, cells[one], cells[other])
            paired = _or_none(
                compare_paired,
                [people[one][person] for person in both],
                [people[other][person] for person in both],
            )
            if unpaired is None and paired is None:
                continue
            tests.append(
                {
                    "panel": environment,
                    "group": number,
                    "first": first,
                    "second": second,
                    "trials": (len(cells[one]), len(cells[other])),
                    "unpaired": unpaired,
                    "paired": paired,
                    "primary": is_primary(plan, first, second, number),
                    "adjusted": paired.p if paired else None,
                }
            )
    family = [test for test in tests if test["paired"] and not test["primary"]]
    adjusted = holm([test["paired"].p for test in family])
    for test, p in zip(family, adjusted, strict=True):
        test["adjusted"] = p
    for test in tests:
        test["stars"] = "" if test["adjusted"] is None else stars_of(test["adjusted"])
    return list(tests)


def _or_none(test: Any, first: Sequence[float], second: Sequence[float]) -> Any:
    try:
        return test(first, second)
    except SampleError:
        return None


def _notes(tests: Sequence[Row], plan: Plan) -> tuple[str, ...]:
    """Sentences on how the tests are to be read."""
    if not tests:
        return ()
    many = plan.trials_per_condition > 1
    over = "means over a person's trials of a condition" if many else "a person's trials"
    counts = (
        "The same people were measured under every condition, so the test that counts is the"
        f" paired t-test, on {over}."
    )
    notes = [counts]
    primary = plan.analysis.primary
    others = sum(test["paired"] is not None and not test["primary"] for test in tests)
    if primary is not None:
        notes.append(
            f"The plan names {primary[0]} against {primary[1]} at the end of a trial as the primary"
            " comparison: its p is not corrected. Holm's method corrects the other"
            f" {others} p-values together."
        )
    else:
        notes.append(
            f"The plan names no primary comparison, so Holm's method corrects all {others} p-values"
            " together."
        )
    unpaired = (
        "The unpaired tests are those of the paper, uncorrected. They take trials as independent,"
        " though each person gave one to every condition"
    )
    if many:
        unpaired += f", and {plan.trials_per_condition} of them: they can find too much"
    notes.append(f"{unpaired}. Where Student's p and the interval disagree, read Welch's p.")
    return tuple(notes)


def _described(
    rows: Sequence[Row], cells: Mapping[Cell, Sequence[float]], unit: str | None
) -> Summary:
    """Mean, standard deviation and quartiles per environment, look and condition."""
    people: dict[Cell, set[str]] = {}
    for row in rows:
        cell = (row["environment"], row["answers"], row["condition"])
        people.setdefault(cell, set()).add(row["participant_id"])
    lines = []
    for cell, scores in cells.items():
        low, middle, high = np.quantile(scores, (0.25, 0.5, 0.75))
        spread = f"{np.std(scores, ddof=1):.4g}" if len(scores) > 1 else ""
        lines.append(
            (
                cell[0],
                str(cell[1]),
                cell[2],
                str(len(scores)),
                str(len(people[cell])),
                f"{np.mean(scores):.4g}",
                spread,
                f"{middle:.4g}",
                f"{low:.4g} to {high:.4g}",
            )
        )
    in_unit = f", in {unit}" if unit else ""
    return Summary(
        f"Scores of the acquired candidates{in_unit}",
        (
            "Environment",
            "Answers",
            "Condition",
            "Trials",
            "People",
            "Mean",
            "SD",
            "Median",
            "Quartiles",
        ),
        lines,
    )


def _tested(tests: Sequence[Row]) -> Iterator[Summary]:
    paired = [test for test in tests if test["paired"] is not None]
    if paired:
        yield Summary(
            "Paired t-tests, two-sided. Difference of the means with its 95 % interval; d_z: the"
            " mean difference over its standard deviation",
            (
                "Environment",
                "Answers",
                "Conditions",
                "People",
                "Difference",
                "t",
                "p",
                "p (Holm)",
                "d_z",
            ),
            [_paired_line(test, test["paired"]) for test in paired],
        )
    unpaired = [test for test in tests if test["unpaired"] is not None]
    if unpaired:
        yield Summary(
            "Unpaired t-tests as in the paper, two-sided and uncorrected. Student's with equal"
            " variances; Welch's belongs to the 95 % interval of the difference; g: Hedges' g",
            (
                "Environment",
                "Answers",
                "Conditions",
                "Trials",
                "Difference",
                "t",
                "p",
                "Welch's t",
                "Welch's p",
                "g",
            ),
            [_unpaired_line(test, test["unpaired"]) for test in unpaired],
        )


def _named(test: Row) -> tuple[str, str, str]:
    return test["panel"], str(test["group"]), f"{test['first']} – {test['second']}"


def _paired_line(test: Row, found: PairedComparison) -> tuple[str, ...]:
    return (
        *_named(test),
        str(found.people),
        f"{found.difference:+.3g} [{found.low:+.3g}, {found.high:+.3g}]",
        f"t({found.freedom}) = {found.t:.3f}",
        f"p {p_value(found.p)}",
        "primary" if test["primary"] else f"p {p_value(test['adjusted'])}",
        f"{found.effect:+.2f}",
    )


def _unpaired_line(test: Row, found: Comparison) -> tuple[str, ...]:
    freedom = sum(test["trials"]) - 2
    return (
        *_named(test),
        "{}, {}".format(*test["trials"]),
        f"{found.difference:+.3g} [{found.low:+.3g}, {found.high:+.3g}]",
        f"t({freedom}) = {found.t:.3f}",
        f"p {p_value(found.p)}",
        f"t({found.welch_freedom:.1f}) = {found.welch_t:.3f}",
        f"p {p_value(found.welch_p)}",
        f"{found.effect:+.2f}",
    )
