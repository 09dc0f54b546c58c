"""The steps from a draft to an open study, each with what is done and what is next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.study.folder import PLACEHOLDER_CAUSE
from app.study.plan_source import STUDY_FILE
from app.study.validation_errors import Fault

DONE, NEXT, LATER = "done", "next", "later"


@dataclass(frozen=True)
class Step:
    """A step. state: done, next or later.

    faults, to_fill: what is wrong, and which placeholders are left, by file.
    """

    key: str
    title: str
    state: str
    faults: Mapping[str, Sequence[Fault]]
    to_fill: Mapping[str, Sequence[Fault]]


def is_placeholder(fault: Fault) -> bool:
    """Whether it is a placeholder of the example, which is work to do and no fault."""
    return fault.cause.startswith(PLACEHOLDER_CAUSE)


def steps(faults: Mapping[str, Sequence[Fault]]) -> list[Step]:
    """The steps of a draft with these faults, the first unfinished one marked as next."""
    titles = {"videos": "Videos and table", "texts": "Texts", "settings": "Settings"}
    by_step: dict[str, dict[str, Sequence[Fault]]] = {key: {} for key in titles}
    for file, found in faults.items():
        by_step[_step_of(file)][file] = found
    made = []
    is_next_found = False
    for key, title in titles.items():
        own = by_step[key]
        state = DONE if not own else LATER if is_next_found else NEXT
        is_next_found = is_next_found or bool(own)
        wrong = {
            file: [one for one in found if not is_placeholder(one)] for file, found in own.items()
        }
        to_fill = {
            file: [one for one in found if is_placeholder(one)] for file, found in own.items()
        }
        made.append(
            Step(
                key,
                title,
                state,
                {file: found for file, found in wrong.items() if found},
                {file: found for file, found in to_fill.items() if found},
            )
        )
    made.append(Step("create", "Create and preview", LATER if is_next_found else NEXT, {}, {}))
    made.append(Step("open", "Open", LATER, {}, {}))
    return made


def _step_of(file: str) -> str:
    if file == STUDY_FILE:
        return "settings"
    return "texts" if file.startswith("texts/") else "videos"
