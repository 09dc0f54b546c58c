"""`pbpo retention`: deleting what studies have promised to delete."""

from __future__ import annotations

from typing import Annotated

import typer

from app.services.accounts.audit_log import COMMAND_LINE
from app.services.maintenance import retention

from .options import DataDir, app_context_of, out

commands = typer.Typer(no_args_is_help=True, help="Delete what studies have promised to delete.")


@commands.callback()
def _group() -> None:
    """Delete what studies have promised to delete."""


@commands.command()
def run(
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what is due, and delete nothing.")
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Delete what is due by each study's retention rule, as the server does every hour."""
    app = app_context_of(data_dir)
    found = retention.run(app, dry_run=dry_run, actor=COMMAND_LINE)
    verb = "would be" if dry_run else "were"
    for slug, swept in found.items():
        if swept.failed:
            out.print(f"{slug}: it failed, and the lines above say why; run it again.")
        out.print(
            f"{slug}: sessions that {verb} deleted: {swept.sessions}; people whose platform ids"
            f" {verb} deleted: {swept.people_without_ids}"
        )
    if not found:
        out.print("Nothing is due.")
    if any(swept.failed for swept in found.values()):
        raise typer.Exit(1)
