"""Environments: where a study's recordings come from.

The recordings of the simulated crane and of a table exist before the study opens, or can be made
from a list. Those of a machine are made when a query needs them, one rollout each.
"""

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field, StrictBool, StrictInt, StrictStr

from .files import misplaced
from .parsed_plan import Inconsistency, Place, as_list, as_mapping
from .plan_model import ONE_OR_MORE_TEXTS, LocalText, Part
from .search_space import has_ranges

CRANE = "crane"
#: A machine that asks the server for work, and the crane as a machine inside the server.
MACHINE = "machine"
CRANE_MACHINE = "machine crane"
MACHINES = (MACHINE, CRANE_MACHINE)
CRANE_ENVIRONMENTS = ("env1", "env2")
CRANE_PARAMETERS = ("w0", "w1")
#: Seconds between which the crane's opening and closing times lie.
CRANE_BOUNDS = (0.0, 1.0)


class RolloutSettings(Part):
    """How recordings are asked of machines."""

    timeout_s: StrictInt = Field(
        default=120, ge=5, le=86_400, description="whole seconds from 5 to 86400"
    )
    attempts: StrictInt = Field(default=3, ge=1, le=20, description="a whole number from 1 to 20")
    reuse: StrictBool = Field(default=True, description="true or false")
    new_per_query: Literal[1, 2] = Field(default=1, description="1 or 2")
    ahead: StrictInt = Field(default=3, ge=0, le=12, description="a whole number from 0 to 12")
    lag: Literal[0, 1] = Field(default=0, description="0 or 1")


class Environment(Part):
    """Where recordings come from: the simulated crane, a table of the study's own, or machines."""

    label: LocalText | None = Field(default=None, description=ONE_OR_MORE_TEXTS)
    source: StrictStr = Field(
        pattern=r"^(crane|machine|machine crane|.*\.([cC][sS][vV]|[tT][sS][vV]|[xX][lL][sS][xX]))$",
        description="crane, machine, machine crane, or the name of a table in the study folder"
        " such as recordings.csv",
    )
    # Left out of a plan's data where not used, so that the hashes of earlier plans stay valid.
    rollout: RolloutSettings = Field(
        default=RolloutSettings(),
        exclude_if=lambda settings: settings == RolloutSettings(),
        description="a mapping such as {timeout_s: 120, ahead: 3}",
    )

    @property
    def is_crane(self) -> bool:
        """Whether recordings come from the list of the simulated crane."""
        return self.source == CRANE

    @property
    def is_machine(self) -> bool:
        """Whether recordings are made when a query needs them, outside the server or inside."""
        return self.source in MACHINES

    @property
    def is_crane_machine(self) -> bool:
        """Whether the machine is the simulated crane inside the server."""
        return self.source == CRANE_MACHINE

    @property
    def has_table(self) -> bool:
        """Whether recordings are listed in a table of the study."""
        return not self.is_crane and not self.is_machine


def environment_inconsistencies(plan: Mapping[str, object]) -> Iterator[Inconsistency]:
    """All contradictions between the environments of a plan, given as plain data, and its rest."""
    read_by: dict[str, str] = {}
    ranges = has_ranges(plan)
    for name, environment in as_mapping(plan.get("environments")).items():
        source = as_mapping(environment).get("source")
        place: Place = ("environments", name, "source")
        if not isinstance(source, str):
            continue
        if source in MACHINES:
            yield from _machine_inconsistencies(place, plan, name, ranges)
        else:
            if ranges:
                expected = f"expected {MACHINE} or {CRANE_MACHINE} for parameters with ranges"
                yield Inconsistency(place, f"{expected}, got {source}")
            if as_mapping(environment).get("rollout") is not None:
                message = f"expected no rollout settings for source {source}, got some"
                yield Inconsistency(("environments", name, "rollout"), message)
        if source in (CRANE, CRANE_MACHINE):
            yield from _crane_inconsistencies(place, plan, name, source)
        elif source != MACHINE:
            problem = misplaced(source)
            if problem is not None:
                yield Inconsistency(place, problem)
            if source in read_by:
                message = f"expected a file of its own, got {source!r}, which {read_by[source]} has"
                yield Inconsistency(place, message)
            read_by.setdefault(source, name)


def _machine_inconsistencies(
    place: Place, plan: Mapping[str, object], name: str, ranges: bool
) -> Iterator[Inconsistency]:
    if not ranges and plan.get("parameters"):
        message = "expected min and max of every parameter for a machine, got neither"
        yield Inconsistency(place, message)
    conditions = [as_mapping(condition) for condition in as_list(plan.get("conditions"))]
    if conditions and all(condition.get("environment") != name for condition in conditions):
        message = f"expected a condition in environment {name}, got none: its machine would idle"
        yield Inconsistency(place, message)


def _crane_inconsistencies(
    place: Place, plan: Mapping[str, object], name: str, source: str
) -> Iterator[Inconsistency]:
    if name not in CRANE_ENVIRONMENTS:
        known = " or ".join(CRANE_ENVIRONMENTS)
        yield Inconsistency(place, f"expected {known} for source {source}, got {name!r}")
    parameters = [as_mapping(parameter) for parameter in as_list(plan.get("parameters"))]
    names = [parameter.get("name") for parameter in parameters]
    if names and tuple(names) != CRANE_PARAMETERS:
        expected, came = ", ".join(CRANE_PARAMETERS), ", ".join(map(str, names))
        message = f"expected the parameters {expected} for source {source}, got {came}"
        yield Inconsistency(place, message)
    if source != CRANE_MACHINE:
        return
    low, high = CRANE_BOUNDS
    for index, parameter in enumerate(parameters):
        for key in ("min", "max"):
            bound = parameter.get(key)
            if not isinstance(bound, int | float) or isinstance(bound, bool):
                continue
            if not low <= bound <= high:
                message = f"expected {low:g} to {high:g} s for source {source}, got {bound}"
                yield Inconsistency(("parameters", index, key), message)
