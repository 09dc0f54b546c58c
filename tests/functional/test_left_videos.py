"""Studies' own videos that no study has any more are thrown away, and no others."""

from __future__ import annotations

import os
import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from app.services import left_videos, lifecycle, periodic_tasks, slugs, studies
from app.services.errors import ConflictError
from app.services.studio import Studio
from tests.conftest import Clock

from .own_study import write_own_study


def names(studio: Studio) -> set[str]:
    return {path.name for path in studio.settings.own_videos.glob("*.mp4")}


def notes(studio: Studio) -> list[Path]:
    return list((studio.settings.data_dir / "left-videos").iterdir())


def age(studio: Studio, clock: Clock, **time: float) -> None:
    """The notes that are there were written so long ago."""
    at = (clock.now() - timedelta(**time)).timestamp()
    for path in notes(studio):
        os.utime(path, (at, at))


def later(studio: Studio, clock: Clock, **time: float) -> int:
    """Sweep when the notes that are there are so old."""
    age(studio, clock, **time)
    return left_videos.sweep(studio)


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


def create(studio: Studio, folder: Path) -> None:
    whole = studies.load_folder(str(folder))
    studies.create(studio, whole, proof=slugs.Proof(is_asked=True))


def test_what_a_draft_that_is_made_again_has_no_more_goes_after_a_day(
    studio: Studio, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(studio, whole)
    assert notes(studio) == []
    create(studio, smaller)
    another = studio.settings.own_videos / f"{'0' * 64}.mp4"
    another.write_bytes(b"another studio's")
    assert later(studio, clock, hours=23) == 0
    assert len(names(studio)) == 5
    assert later(studio, clock, hours=25) == 1
    assert notes(studio) == []
    assert another.exists()
    studies.open_study(studio, "kettles")
    assert len(names(studio)) == 4


def test_what_a_study_that_was_refused_has_brought_goes_after_a_day(
    studio: Studio, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(studio, smaller)
    studies.open_study(studio, "kettles")
    kept = names(studio)
    with pytest.raises(ConflictError, match="is open"):
        create(studio, whole)
    assert len(names(studio)) == 4
    age(studio, clock, days=2)
    # As the server does it each hour.
    periodic_tasks.run_all(studio)
    assert names(studio) == kept


def test_a_study_that_is_put_together_keeps_what_another_one_that_goes_has_too(
    studio: Studio, smaller: Path, clock: Clock
) -> None:
    create(studio, smaller)
    shared, *_ = sorted(names(studio))
    with left_videos.until_stored(studio, {shared}):
        lifecycle.delete(studio, "kettles")
        assert names(studio) == {shared}
        assert later(studio, clock, hours=23) == 0
    assert notes(studio) == []
    # A process that was killed over it is not waited for.
    with left_videos.until_stored(studio, {shared}):
        assert later(studio, clock, hours=25) == 1
    assert names(studio) == set()


def test_a_sweep_that_is_told_to_stop_goes_on_the_next_time(
    studio: Studio, whole: Path, smaller: Path, clock: Clock
) -> None:
    create(studio, whole)
    create(studio, smaller)
    age(studio, clock, days=2)
    assert left_videos.sweep(studio, lambda: True) == 0
    assert left_videos.sweep(studio) == 1
