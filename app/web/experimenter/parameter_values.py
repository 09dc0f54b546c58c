"""Values of a candidate's parameters as pages for machines and operators show them."""

from __future__ import annotations

from typing import Any

from app.services.studies.repository import StudyInfo


def named(study: StudyInfo, parameters: Any, digits: int = 6) -> list[tuple[str, str, str]]:
    """Label, value and unit of each parameter, in the plan's order."""
    plan = study.plan
    return [
        (
            plan.text(one.label or one.name, plan.default_language),
            f"{parameters[one.name]:.{digits}g}",
            one.unit or "",
        )
        for one in plan.parameters
        if one.name in parameters
    ]


def in_words(study: StudyInfo, parameters: Any) -> str:
    """All of them in one line, shortened."""
    return ", ".join(
        f"{label} {value}{f' {unit}' if unit else ''}"
        for label, value, unit in named(study, parameters, digits=4)
    )
