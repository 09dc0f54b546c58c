"""`pbpo study ...`: what becomes of a study once it is there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.services.studies import folder_export, lifecycle
from app.study.scaffold import require_empty

from .options import DataDir, Slug, app_context_of, out

app = typer.Typer()


@app.command("pause")
def pause(slug: Slug, data_dir: DataDir = None) -> None:
    """Let nobody in for a while; sessions under way go on."""
    lifecycle.pause(app_context_of(data_dir), slug)
    out.print(f"{slug} is paused. To let people in again: pbpo study resume {slug}")


@app.command("resume")
def resume(slug: Slug, data_dir: DataDir = None) -> None:
    """Let people in again."""
    lifecycle.resume(app_context_of(data_dir), slug)
    out.print(f"{slug} lets people in again.")


@app.command("clone")
def clone(
    slug: Slug,
    folder: Annotated[Path, typer.Argument(help="A new or empty folder.", metavar="FOLDER")],
    new_slug: Annotated[
        str, typer.Option("--slug", help="The copy's slug. Default: the study's, and -copy.")
    ] = "",
    data_dir: DataDir = None,
) -> None:
    """Write a study's plan, texts, table and videos into a folder, to make another one of."""
    require_empty(folder)
    folder_export.write_folder(app_context_of(data_dir), slug, folder, new_slug or f"{slug}-copy")
    out.print(f"{folder} holds a copy of {slug}. Change it, then: pbpo study check {folder}")


@app.command("delete")
def delete(
    slug: Slug,
    confirm: Annotated[
        str, typer.Option(help="For a closed study: its slug once more. Its data is gone for good.")
    ] = "",
    data_dir: DataDir = None,
) -> None:
    """Delete a draft, or a closed study with all its data; the audit trail remains."""
    lifecycle.delete(app_context_of(data_dir), slug, typed=confirm)
    out.print(f"{slug} is deleted.")
