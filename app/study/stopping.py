"""When a trial is sure enough of its best candidate, and when that ends it early."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pydantic import Field

from .parsed_plan import Inconsistency, as_list, as_mapping
from .plan_model import Finite, Part

#: Being better by less than this share of the range of a trial's function makes no difference,
#: unless the plan says another.
USUAL_WITHIN: Final = 0.1


class Stop(Part):
    """A trial ends after the first response by which its model is that sure.

    The model is sure in the sense of `PreferenceOptimizer.sureness(within)`: a model that people
    share of what the population likes best, or with `for: person` of what the person does. A
    knockout has none.
    """

    sure: Finite = Field(
        ge=0.5, lt=1, description="a number from 0.5 to below 1, the probability such as 0.95"
    )
    within: Finite = Field(
        default=USUAL_WITHIN,
        ge=0,
        lt=1,
        description="a number from 0 to below 1, the share of the range that makes no difference",
    )


def stop_inconsistencies(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """A stop without a condition under which a model could be sure."""
    if plan.get("stop") is None:
        return
    conditions = [as_mapping(condition) for condition in as_list(plan.get("conditions"))]
    if conditions and all(one.get("method") == "knockout" for one in conditions):
        yield Inconsistency(("stop",), "expected a condition with a model, got knockouts alone")
