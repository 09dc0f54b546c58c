"""`pbpo backup` and `pbpo restore`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.services.context import utc_now
from app.services.maintenance import backups
from app.services.maintenance.backups import Backup
from app.services.runtime.errors import ConflictError

from .options import DataDir, out, settings_of


def backup(
    target: Annotated[Path, typer.Option("--out", help="The file to write: a new one.")],
    data_dir: DataDir = None,
) -> None:
    """Write the database and studies' own videos into one file, while the server runs."""
    _say(backups.backup(settings_of(data_dir), target, utc_now()))
    out.print(f"{target} is whole. It holds what people gave: keep it as safely as the data.")


def restore(
    source: Annotated[Path, typer.Argument(help="A backup.", metavar="FILE")],
    deletions: Annotated[
        list[Path] | None,
        typer.Option(
            help="The ledger of the server that was backed up (deletions.log in its data folder);"
            " may be repeated."
        ),
    ] = None,
    without_deletions: Annotated[
        bool,
        typer.Option(
            "--without-deletions",
            help="The ledger is lost: what was deleted since the backup comes back.",
        ),
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Make a studio of a backup, in a new folder, and delete again what was deleted since."""
    if bool(deletions) == without_deletions:
        raise ConflictError(
            "expected either --deletions LEDGER (deletions.log in the data folder that was backed"
            " up, as it is now), or --without-deletions if that is lost"
        )
    restored = backups.restore(source, settings_of(data_dir), deletions or [], utc_now())
    _say(restored.backup)
    out.print(
        f"Restored as it was backed up; deletions carried out again: {restored.deleted_again}."
    )
    if restored.missing:
        out.print(
            f"Videos of studies that are missing where recordings are kept: {restored.missing}."
            " Put them there (docs/operations.md)."
        )


def _say(held: Backup) -> None:
    rows = {name: held.rows.get(name, 0) for name in ("studies", "sessions", "responses")}
    said = ", ".join(f"{name}: {number}" for name, number in rows.items())
    out.print(
        f"{said}, files besides: {held.files}; {held.bytes / 1e6:.1f} MB, schema {held.schema},"
        f" made at {held.made_at:%Y-%m-%d %H:%M:%S} UTC."
    )
    if held.elsewhere:
        out.print(f"Videos in {held.store} are named in it, and not copied: {held.elsewhere}.")
