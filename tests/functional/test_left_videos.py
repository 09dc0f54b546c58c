"""Studies' own videos that no study has any more are thrown away, and no others."""

from __future__ import annotations

import os
import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.maintenance import periodic_tasks
from app.services.runtime.errors import ConflictError
from app.services.studies import lifecycle, orphaned_videos, repository, slugs
from tests.conftest import Clock

from .own_study import write_own_study


def names(app: AppContext) -> set[str]:
    return {path.name for path in app.settings.own_videos.glob("*.mp4")}


def notes(app: AppContext) -> list[Path]:
    return list((app.settings.data_dir / "left-videos").iterdir())


def age(app: AppContext, clock: Clock, **time: float) -> None:
    """The notes that are there were written so long ago."""
    at = (clock.now() - timedelta(**time)).timestamp()
    for path in notes(app):
        os.utime(path, (at, at))


def later(app: AppContext, clock: Clock, **time: float) -> int:
    """Sweep when the notes that are there are so old."""
    age(app, clock, **time)
    return orphaned_videos.sweep(app)


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """A study of four videos."""
    return write_own_study(tmp_path / "whole")


@pytest.fixture
def smaller(whole: Path, tmp_path: Path) -> Path:
    """The same study without one of them."""
    folder = shutil.copytree(whole, tmp_path / "smaller")
    (folder / "videos" / "b.mp4").unlink()
    table = folder / "recordings.csv"
    kept = [line for line in table.read_text().splitlines() if "b.mp4" not in line]
    table.write_text("\n".join(kept))
    return folder


def create(app: AppContext, folder: Path) -> None:
    whole = repository.load_folder(str(folder))
    repository.create(app, whole, proof=slugs.Proof(is_asked=True))


def test_what_a_draft_that_is_made_again_has_no_more_goes_after_a_day(
    app: AppContext, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(app, whole)
    assert notes(app) == []
    create(app, smaller)
    another = app.settings.own_videos / f"{'0' * 64}.mp4"
    another.write_bytes(b"another studio's")
    assert later(app, clock, hours=23) == 0
    assert len(names(app)) == 5
    assert later(app, clock, hours=25) == 1
    assert notes(app) == []
    assert another.exists()
    repository.open_study(app, "kettles")
    assert len(names(app)) == 4


def test_what_a_study_that_was_refused_has_brought_goes_after_a_day(
    app: AppContext, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(app, smaller)
    repository.open_study(app, "kettles")
    kept = names(app)
    with pytest.raises(ConflictError, match="is open"):
        create(app, whole)
    assert len(names(app)) == 4
    age(app, clock, days=2)
    # As the server does it each hour.
    periodic_tasks.run_all(app)
    assert names(app) == kept


def test_a_study_that_is_put_together_keeps_what_another_one_that_goes_has_too(
    app: AppContext, smaller: Path, clock: Clock
) -> None:
    create(app, smaller)
    shared, *_ = sorted(names(app))
    with orphaned_videos.mark_in_use(app, {shared}):
        lifecycle.delete(app, "kettles")
        assert names(app) == {shared}
        assert later(app, clock, hours=23) == 0
    assert notes(app) == []
    # A process that was killed over it is not waited for.
    with orphaned_videos.mark_in_use(app, {shared}):
        assert later(app, clock, hours=25) == 1
    assert names(app) == set()


def test_a_sweep_that_is_told_to_stop_goes_on_the_next_time(
    app: AppContext, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(app, whole)
    create(app, smaller)
    age(app, clock, days=2)
    assert orphaned_videos.sweep(app, lambda: True) == 0
    assert orphaned_videos.sweep(app) == 1
