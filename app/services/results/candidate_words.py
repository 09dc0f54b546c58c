"""Names a candidate by its parameters, in the words and units of the study."""

from __future__ import annotations

from collections.abc import Mapping

from app.study.plan import Plan
from app.study.search_space import Parameter


def label(parameter: Parameter, plan: Plan) -> str:
    """The label of a parameter as the study writes it, or else its name."""
    return plan.text(parameter.label, plan.default_language) if parameter.label else parameter.name


def in_words(parameters: Mapping[str, float], plan: Plan) -> str:
    """The parameters with their labels and units: "Opening time 0.25 s, Closing time 0.4 s"."""
    return ", ".join(
        f"{label(one, plan)} {parameters[one.name]:g}{f' {one.unit}' if one.unit else ''}"
        for one in plan.parameters
        if one.name in parameters
    )
