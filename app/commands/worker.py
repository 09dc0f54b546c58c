"""`pbpo worker`: what servers leave to it is done here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import DataDir, out, settings_of


def worker(
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=64, help="Videos at a time. Default: PBPO_RENDER_JOBS."),
    ] = None,
    alive: Annotated[
        Path | None,
        typer.Option(help="A file to touch as long as the worker reaches the database."),
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Make videos, do jobs and keep retention rules for servers that leave these to workers.

    PBPO_WORKERS_APART has to be true, here as for the servers. Logs are lines of JSON on standard
    error.
    """
    settings = settings_of(data_dir)
    # A command loads only what it needs, and this is all of the application.
    from app.services.monitoring import startup_checks  # noqa: PLC0415

    startup_checks.require_workers_apart(settings)
    from app.worker import work  # noqa: PLC0415

    videos = jobs or settings.render_jobs
    work(
        settings,
        videos,
        lambda: out.print(
            f"This worker makes videos, {videos} at a time, does jobs, one at a time, and deletes"
            " what studies have promised to delete."
        ),
        alive=alive,
    )
