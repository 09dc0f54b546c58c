"""Settings of the analysis: the primary comparison, and the unit of the scores."""

from collections.abc import Iterator, Mapping

from pydantic import Field, StrictStr

from .parsed_plan import Inconsistency, as_list, as_mapping
from .plan_model import Part


class Analysis(Part):
    """What is fixed about the analysis before the data are seen."""

    primary: tuple[StrictStr, StrictStr] | None = Field(
        default=None,
        description="a list of two conditions of one environment such as [pbpo, pbpo-no-skip]",
    )
    score_unit: StrictStr | None = Field(
        default=None, min_length=1, max_length=20, description="the unit of the scores such as g"
    )


def analysis_inconsistencies(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """A primary comparison of conditions that the plan lacks, or that cannot be compared."""
    place = ("analysis", "primary")
    primary = as_list(as_mapping(plan.get("analysis")).get("primary"))
    if len(primary) != 2 or not all(isinstance(name, str) for name in primary):
        return
    conditions = [as_mapping(condition) for condition in as_list(plan.get("conditions"))]
    environments = {condition.get("name"): condition.get("environment") for condition in conditions}
    first, second = primary
    for index, name in enumerate(primary):
        if name not in environments:
            known = ", ".join(str(name) for name in environments)
            yield Inconsistency(
                (*place, index), f"expected one of the conditions ({known}), got {name!r}"
            )
    if first == second:
        yield Inconsistency(place, f"expected two different conditions, got {first!r} twice")
    elif (
        first in environments
        and second in environments
        and environments[first] != environments[second]
    ):
        yield Inconsistency(
            place,
            "expected two conditions of one environment, got"
            f" {environments[first]} and {environments[second]}",
        )
