"""The results of people judged together: figures, sentences and the table of people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from app.pbbo.people_summary import PeopleSummary
from app.services.pooling.people import DIFFERS, Person, PooledPeople
from app.study.plan import Plan

from . import people_words as words
from .result import Result, Row, Summary
from .trial_posterior import percent

#: The columns of the table of people.
HEADER: Final = (
    "Person",
    "Answers",
    "Own best",
    "Costs",
    "Own taste",
    "Most like",
    "Kind",
    "Noise",
    "Influence",
    "Best without",
    "Reasons",
)


@dataclass(frozen=True)
class PeopleFinding:
    """One figure. title: heading. about: what it shows, in a sentence.

    is_wide: whether it takes the whole width of a page.
    """

    title: str
    about: str
    read: Callable[[PooledPeople, PeopleSummary, Plan], Result]
    is_wide: bool = False


def read(name: str, found: PooledPeople, plan: Plan) -> Result:
    """One figure's result. name: a key of PEOPLE_FINDINGS."""
    if found.summary is None:
        return Result((), found.why_not or "Being computed.")
    return PEOPLE_FINDINGS[name].read(found, found.summary, plan)


def sentences(found: PooledPeople, summary: PeopleSummary, plan: Plan) -> tuple[str, ...]:
    """What is found, in words."""
    return (
        words.best(found, summary, plan),
        words.own_taste(found, summary),
        words.kinds(summary),
        words.influence(found),
        words.reliable(found),
    )


def table_of_people(
    found: PooledPeople, summary: PeopleSummary, plan: Plan, people: Sequence[Person] | None = None
) -> Summary:
    """The table of people, by default all of them."""
    return Summary(
        "People, judged together. Costs: how far the population's best lies below their own best,"
        " in their own values. Noise: of the average, with its 90 % interval",
        HEADER,
        [_line(found, summary, plan, one) for one in (found.people if people is None else people)],
    )


def _line(
    found: PooledPeople, summary: PeopleSummary, plan: Plan, person: Person
) -> tuple[str, ...]:
    one = person.summary
    moved = one.best_without != summary.best
    return (
        person.name,
        str(one.answers) + (f" ({one.skips} skip{'s' * (one.skips > 1)})" if one.skips else ""),
        words.point(summary, one.best, plan),
        f"{percent(one.costs)}{', differs' if person.differs else ''}",
        f"{percent(one.own_share)}",
        "" if one.nearest is None else found.people[one.nearest].name,
        "" if one.kind is None else str(one.kind + 1),
        f"{one.noise.value:.1f} [{one.noise.low:g}, {one.noise.high:g}]",
        f"{one.influence:.2f}",
        words.point(summary, one.best_without, plan) if moved else "the same",
        " ".join(person.reasons),
    )


def population(found: PooledPeople, summary: PeopleSummary, plan: Plan) -> Result:
    """The population's values over the candidates, with each person's own best."""
    rows: list[Row] = [
        {
            "candidate": found.candidate(row),
            **_at(summary, row, plan),
            "posterior_mean": float(summary.mean[row]),
            "posterior_std": float(summary.std[row]),
            "disagreement": float(summary.disagreement[row]),
            "best_probability": float(summary.best_probability[row]),
        }
        for row in range(len(summary.points))
    ]
    bests = [_at(summary, person.summary.best, plan) for person in found.people]
    return Result(
        rows,
        words.best(found, summary, plan),
        extra={"best": summary.best, "bests": bests},
    )


def taste_and_reliability(found: PooledPeople, _summary: PeopleSummary, _plan: Plan) -> Result:
    """Each person's costs and noise."""
    rows: list[Row] = [
        {
            "participant_id": person.name,
            "costs": person.summary.costs,
            "noise": person.summary.noise.value,
            "differs": person.differs,
            "flagged": bool(person.reasons),
        }
        for person in found.people
    ]
    differ = sum(person.differs for person in found.people)
    flagged = sum(bool(person.reasons) for person in found.people)
    both = sum(person.differs and bool(person.reasons) for person in found.people)
    says = (
        f"Of {len(rows)} people {differ} differ from the population and {flagged} are flagged;"
        f" {both} are both."
    )
    return Result(rows, says)


def noise(found: PooledPeople, _summary: PeopleSummary, _plan: Plan) -> Result:
    """Each person's noise with its interval, the least noisy first."""
    ordered = sorted(found.people, key=lambda person: person.summary.noise.value)
    rows: list[Row] = [
        {
            "participant_id": person.name,
            "answers": person.summary.answers,
            "noise": person.summary.noise.value,
            "low": person.summary.noise.low,
            "high": person.summary.noise.high,
            "probability": person.summary.noisy,
        }
        for person in ordered
    ]
    first, last = rows[0]["noise"], rows[-1]["noise"]
    return Result(rows, f"Noise runs from {first:.1f} to {last:.1f} times the usual.")


def influence(found: PooledPeople, summary: PeopleSummary, plan: Plan) -> Result:
    """How much each person moves the population's values, the most first."""
    ordered = sorted(found.people, key=lambda person: -person.summary.influence)
    rows: list[Row] = [
        {
            "participant_id": person.name,
            "answers": person.summary.answers,
            "influence": person.summary.influence,
            "candidate_without": found.candidate(person.summary.best_without),
            "moves": person.summary.moves,
        }
        for person in ordered
    ]
    return Result(rows, words.influence(found))


def _at(summary: PeopleSummary, row: int, plan: Plan) -> dict[str, float]:
    names = [parameter.name for parameter in plan.parameters]
    return dict(zip(names, summary.points[row].tolist(), strict=True))


PEOPLE_FINDINGS: Final[Mapping[str, PeopleFinding]] = MappingProxyType(
    {
        "population": PeopleFinding(
            "What people like together",
            "The population's values, how unsure they are, and where people disagree. Dots are"
            " people's own bests; red is the population's.",
            population,
            is_wide=True,
        ),
        "taste-and-reliability": PeopleFinding(
            "Taste and reliability",
            "To the right are people who like something else, above those whose answers follow"
            f" nothing. From {percent(DIFFERS)} on a person differs; a noise of 1 is usual.",
            taste_and_reliability,
        ),
        "noise": PeopleFinding(
            "Noise",
            "Each person's noise, as a multiple of the usual, with its 90 % interval.",
            noise,
        ),
        "influence": PeopleFinding(
            "Influence",
            "By how much the population's values change without each person, in their standard"
            " deviations.",
            influence,
        ),
    }
)
