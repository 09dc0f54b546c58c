"""`pbpo study transcode`: videos that every browser plays."""

from __future__ import annotations

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from app.services.runtime.errors import ConflictError
from app.study.folder import resolve
from app.study.transcoding import transcode_folder
from app.video.video_info import UnreadableVideoError

from .options import Folder, out

app = typer.Typer()


@app.command("transcode")
def transcode(folder: Folder) -> None:
    """Make videos that every browser plays of those that some cannot; the old files stay."""
    columns = (BarColumn(), MofNCompleteColumn(), "seconds", TimeRemainingColumn())
    with Progress("transcoding", *columns, console=out, transient=True) as progress:
        task = progress.add_task("", total=None)
        try:
            names = transcode_folder(
                resolve(folder),
                lambda done, total: progress.update(task, completed=done, total=total),
                keep=True,
            )
        except UnreadableVideoError as error:
            raise ConflictError(str(error)) from error
    for name in names:
        out.print(name)
    out.print(f"{len(names)} videos transcoded. To check the folder: pbpo study check {folder}")
