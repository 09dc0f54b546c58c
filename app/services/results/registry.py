"""The registry of the results across sessions: title, description and function of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.export.table import Request

from . import acquired, acquired_scores, response_behaviour, sureness, win_rates
from .result import Result


@dataclass(frozen=True)
class Finding:
    """One entry. title: heading on the page. about: what the figure shows, in a sentence.

    is_wide: whether the figure takes the whole width of a page.
    """

    title: str
    about: str
    read: Callable[[Session, Request], Result]
    is_wide: bool = False


FINDINGS: Final[Mapping[str, Finding]] = MappingProxyType(
    {
        "acquired-on-w": Finding(
            "What was acquired",
            "The candidate that each finished trial ended with, per condition.",
            acquired.on_w,
            is_wide=True,
        ),
        "acquired-scores": Finding(
            "Scores of what was acquired",
            "Per condition after so many answers that the method learned from; the last number is"
            " the end of a trial. A violin is one condition's trials, with the median and the"
            " middle half; fewer than eight trials are dots. Stars: * p < .05, ** p < .01, paired"
            " t-tests corrected by Holm's method.",
            acquired_scores.scores_acquired,
            is_wide=True,
        ),
        "how-sure": Finding(
            "How sure",
            "How sure the models are of what is acquired: the median trial per condition, and the"
            " middle half.",
            sureness.how_sure,
        ),
        "win-rates": Finding(
            "Win rates",
            "How often the candidates that were compared most win against the average of all.",
            win_rates.rates,
        ),
        "skips": Finding(
            "Skips per evaluator",
            "A bar is an evaluator's mean, a dot one trial.",
            response_behaviour.skips,
        ),
        "response-times": Finding(
            "Response times",
            "From both videos having begun to the answer: the median, and the middle half.",
            response_behaviour.response_times,
        ),
        "sides": Finding(
            "Left and right",
            "Each evaluator's share of choices on the left, with its 95 % interval.",
            response_behaviour.sides,
        ),
        "repeats": Finding(
            "Agreement on repeats",
            "How often a pair shown again with its sides swapped was answered alike.",
            response_behaviour.repeats,
        ),
    }
)


def find(app: AppContext, request: Request, name: str) -> Result:
    """Compute one result. name: a key of FINDINGS."""
    with app.database.read() as db:
        return FINDINGS[name].read(db, request)
