"""Sentences on people judged together, for the page, the report and the command line."""

from __future__ import annotations

from collections import Counter
from typing import Final

from app.pbbo.people_summary import NOISY, PeopleSummary
from app.services.pooling.people import PooledPeople
from app.services.pooling.reliability import LEAST_NOISY
from app.study.plan import Plan

from .candidate_words import in_words, label
from .trial_posterior import percent

#: Words for small numbers at the beginning of a sentence.
_NUMBERS: Final = {2: "Two", 3: "Three", 4: "Four"}

#: How the numbers are to be read.
NOTES: Final = (
    (
        "One model is fitted to all answers: what people like in common, and each person's own"
        " deviation from it, threshold and noise. It need not be the model that proposed the pairs."
    ),
    (
        "A person who differs consistently has a taste of their own and counts as reliable. A"
        " reason against relying on a person is that their choices follow nothing (a noise of"
        f" {NOISY:g} times the average or more with a probability of {percent(LEAST_NOISY)} or"
        " more), or one of the flags of the Data page, which are of whole sessions."
    ),
    (
        "Influence is worked out by taking a person's answers out of the fit; noises and the share"
        " of own taste stay as they are."
    ),
)


def best(found: PooledPeople, summary: PeopleSummary, plan: Plan) -> str:
    """What the population likes best, with its interval and how sure that is."""
    index = found.candidate(summary.best)
    named = "a point that was not shown" if index is None else f"candidate {index}"
    between = "; ".join(
        f"{label(parameter, plan)} {one.low:g} to {one.high:g}"
        f"{f' {parameter.unit}' if parameter.unit else ''}"
        for parameter, one in zip(plan.parameters, summary.where, strict=True)
    )
    return (
        f"{len(found.people)} people together like {point(summary, summary.best, plan)} best"
        f" ({named}). With a probability of 90 %, the best lies within: {between}. With a"
        f" probability of {percent(summary.sure)}, no candidate is better by more than a tenth of"
        " the range."
    )


def point(summary: PeopleSummary, row: int, plan: Plan) -> str:
    """A point in the study's words."""
    names = [parameter.name for parameter in plan.parameters]
    return in_words(dict(zip(names, summary.points[row].tolist(), strict=True)), plan)


def own_taste(found: PooledPeople, summary: PeopleSummary) -> str:
    """The share of own taste, and who differs."""
    share = summary.own_share
    differ = sum(person.differs for person in found.people)
    said = (
        f"{percent(share.value)} of the variance of people's values is a taste of their own (90 %"
        f" interval {percent(share.low)} to {percent(share.high)})."
    )
    if differ == 0:
        return f"{said} The population's best suits everybody nearly as well as their own."
    likes = "1 person likes" if differ == 1 else f"{differ} people like"
    return (
        f"{said} {likes} something else: the population's best lies a quarter of their own range"
        " or more below their own best."
    )


def kinds(summary: PeopleSummary) -> str:
    """Kinds of taste, as far as they can be told apart."""
    if summary.kinds.number < 2:
        return "No kinds of taste can be told apart."
    sizes = [count for _, count in sorted(Counter(summary.kinds.of).items())]
    return (
        f"{_NUMBERS[summary.kinds.number]} kinds of taste can be told apart, of"
        f" {' and '.join(str(size) for size in sizes)} people."
    )


def reliable(found: PooledPeople) -> str:
    """How many people there is a reason against."""
    flagged = [person for person in found.people if person.reasons]
    if not flagged:
        return f"Nothing speaks against relying on any of the {len(found.people)} people."
    of = "person" if len(flagged) == 1 else "people"
    return (
        f"Something speaks against relying on {len(flagged)} of {len(found.people)} people; the"
        f" reason{'s are' if len(flagged) > 1 else ' is'} given with the {of}. No one is left out"
        " for it."
    )


def influence(found: PooledPeople) -> str:
    """How the population's best moves without each person."""
    moved = [
        person.summary
        for person in found.people
        if person.summary.best_without != (found.summary.best if found.summary else -1)
    ]
    if not moved:
        return "The population's best stays the same if any one person is left out."
    furthest = percent(max(one.moves for one in moved))
    return (
        f"Without one person the population's best is another candidate for {len(moved)} of"
        f" {len(found.people)} people; it lies at most {furthest} of the range below."
    )
