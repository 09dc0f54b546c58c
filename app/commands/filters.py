"""The options by which commands choose sessions and trials, said once for all of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date, datetime
from enum import StrEnum
from functools import wraps
from typing import Annotated

import typer

from app.services import export as exports
from app.services.context import AppContext
from app.services.export import Request
from app.services.monitoring.data_quality import Flag
from app.services.studies import repository


class Mode(StrEnum):
    live = "live"
    preview = "preview"
    pilot = "pilot"
    simulated = "simulated"
    all = "all"


@dataclass(frozen=True)
class Filters:
    """The choice that the options make; each field is an option."""

    mode: Annotated[
        list[Mode] | None,
        typer.Option("--mode", help="Which sessions count; may be repeated. Default: live."),
    ] = None
    condition: Annotated[
        list[str] | None,
        typer.Option("--condition", help="Only trials under this condition; may be repeated."),
    ] = None
    since: Annotated[
        datetime | None,
        typer.Option(
            "--from", formats=["%Y-%m-%d"], help="First day, in UTC, on which sessions began."
        ),
    ] = None
    until: Annotated[
        datetime | None,
        typer.Option("--to", formats=["%Y-%m-%d"], help="Last day on which sessions began."),
    ] = None
    exclude_flagged: Annotated[
        bool, typer.Option("--exclude-flagged", help="Leave sessions with any quality flag out.")
    ] = False
    exclude_flag: Annotated[
        list[Flag] | None,
        typer.Option("--exclude-flag", help="Leave sessions with this flag out; may be repeated."),
    ] = None
    completed: Annotated[bool, typer.Option("--completed", help="Only completed sessions.")] = False

    @property
    def are_given(self) -> bool:
        """Whether any option was."""
        return any(vars(self).values())

    def request(self, app: AppContext, slug: str) -> Request:
        """What the options ask for. Raises ServiceError."""
        return exports.resolve_flags(
            app,
            Request(
                repository.find(app, slug),
                exports.modes_of([str(chosen) for chosen in self.mode or ()]),
                tuple(dict.fromkeys(self.condition or ())),
                _day(self.since),
                _day(self.until),
                exports.ALL_FLAGS if self.exclude_flagged else tuple(self.exclude_flag or ()),
                self.completed,
            ),
        )


def with_filters(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for each field of its parameter `filters`, in its place."""
    own = inspect.signature(command, eval_str=True)
    options = [
        one.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for one in inspect.signature(Filters, eval_str=True).parameters.values()
    ]

    @wraps(command)
    def filtered(**given: object) -> None:
        chosen = {one.name: given.pop(one.name) for one in options}
        command(filters=Filters(**chosen), **given)  # type: ignore[arg-type]

    parameters: list[inspect.Parameter] = []
    for one in own.parameters.values():
        replaced = options if one.name == "filters" else [one]
        parameters += [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in replaced]
    filtered.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    filtered.__annotations__ = {one.name: one.annotation for one in parameters}
    return filtered


def _day(moment: datetime | None) -> date | None:
    return moment and moment.date()
