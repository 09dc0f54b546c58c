"""Writes a stored study back to a folder, from which a copy or a replacement can be created."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from sqlalchemy import select
from sqlalchemy.orm import joinedload

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.storage.models.studies import Candidate, Recording
from app.study.folder import text_path
from app.study.plan import Plan
from app.study.plan_source import STUDY_FILE
from app.study.plan_to_yaml import plan_text
from app.study.table_headers import FILE_COLUMN, SCORE_COLUMN

from . import repository


def write_folder(app: AppContext, slug: str, folder: Path, new_slug: str) -> None:
    """Write the study's plan under `new_slug`, its texts, tables and videos into a new folder.

    Raises NotFoundError, or ConflictError if a video is missing.
    """
    study = repository.find(app, slug)
    plan = study.plan.model_copy(update={"slug": new_slug})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STUDY_FILE).write_text(plan_text(plan), encoding="utf-8")
    for language, texts in study.texts.items():
        for name, text in texts.items():
            path = folder / text_path(language, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    for name, environment in plan.environments.items():
        if environment.has_table:
            _write_table(app, study.id, plan, name, folder)


def _write_table(
    app: AppContext, study_id: int, plan: Plan, environment: str, folder: Path
) -> None:
    source = PurePosixPath(plan.environments[environment].source)
    if source.suffix.lower() != ".csv":
        # Where a plan names an Excel file, a CSV of the same name is read in its place.
        source = source.with_suffix(".csv")
    names = [parameter.name for parameter in plan.parameters]
    table = folder / source
    table.parent.mkdir(parents=True, exist_ok=True)
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*names, FILE_COLUMN, SCORE_COLUMN])
        for candidate, recording in _recordings(app, study_id, environment):
            assert recording.file is not None  # only crane recordings have none
            if not app.recordings.copy_to(recording, folder / recording.file):
                raise ConflictError(
                    f"expected the video {recording.file!r} among the studio's, it is missing"
                )
            score = "" if recording.score is None else repr(recording.score)
            cell = PurePosixPath(recording.file)
            if cell.is_relative_to(source.parent):
                cell = cell.relative_to(source.parent)
            point = [_cell(candidate.parameters[name]) for name in names]
            writer.writerow([*point, cell.as_posix(), score])


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else repr(value)


def _recordings(
    app: AppContext, study_id: int, environment: str
) -> Iterator[tuple[Candidate, Recording]]:
    with app.database.read() as db:
        yield from (
            (recording.candidate, recording)
            for recording in db.scalars(
                select(Recording)
                .join(Candidate, Recording.candidate_id == Candidate.id)
                .options(joinedload(Recording.candidate))
                .where(Candidate.study_id == study_id, Candidate.environment == environment)
                .order_by(Candidate.candidate_index, Recording.run_index)
            )
        )
