"""What the commands share: the options that several of them have, and the studio they work on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from rich.console import Console

from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.runtime.settings import Settings, settings_faults

out = Console(highlight=False, soft_wrap=True)

DataDir = Annotated[
    Path | None,
    typer.Option(
        help="Where data is kept. [env: PBPO_DATA_DIR; default: data]", show_default=False
    ),
]
Slug = Annotated[str, typer.Argument(help="The study's slug.", metavar="SLUG")]
Folder = Annotated[
    str, typer.Argument(help="A study's folder, or the name of a shipped study.", metavar="FOLDER")
]
Address = Annotated[
    str, typer.Option(help="What comes before the path, such as https://lab.example.")
]


def settings_of(data_dir: Path | None) -> Settings:
    try:
        return Settings() if data_dir is None else Settings(data_dir=data_dir)
    except ValidationError as error:
        raise ConflictError(settings_faults(error)) from None


#: Closes, when a command ends, what it has opened.
_OPENED: ContextVar[ExitStack] = ContextVar("opened")


@contextmanager
def closing_studios() -> Iterator[None]:
    """Close every studio that was opened within, however it is left."""
    with ExitStack() as opened:
        token = _OPENED.set(opened)
        try:
            yield
        finally:
            _OPENED.reset(token)


def app_context_of(data_dir: Path | None, **changes: Any) -> AppContext:
    app = open_app(settings_of(data_dir), **changes)
    _OPENED.get().callback(app.close)
    return app


def address_of(app: AppContext, path: str, address: str = "") -> str:
    """The path at the address that was given, else at the studio's own where it is known.

    The address may be the host's, or include PBPO_ROOT_PATH.
    """
    base, root = address.rstrip("/") or app.settings.public_url, app.settings.root_path
    return f"{base.removesuffix(root)}{root}{path}"


def say_links(app: AppContext, paths: Sequence[str], address: str) -> None:
    """Print links plainly: they must come out whole however narrow the window is."""
    for path in paths:
        print(address_of(app, path, address))
    if not address and not app.settings.public_url:
        typer.echo(
            "This is no whole address, since the studio does not know its own: set"
            " PBPO_PUBLIC_URL, or give --address https://...",
            err=True,
        )
