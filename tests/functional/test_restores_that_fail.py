"""A restore that fails, at whatever moment, brings back nobody and leaves nothing behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import backups
from app.services.runtime.errors import ConflictError, StoreAwayError
from app.services.sessions import withdrawal
from tests.conftest import STARTED
from tests.forked import CONTEXT

from .backed_up import FitProcess, elsewhere, ledger_of, people, rows_of
from .client import Session
from .killed_restore import restore_and_be_killed

__all__ = ["elsewhere", "people"]


def rewritten(source: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """Another backup, with every file as `change` makes it of its name and its bytes."""
    path = source.with_name(f"rewritten-{source.name}")
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = change(name, old.read(name))
            if data is not None:
                new.writestr(name, data)
    return path


def test_a_backup_that_is_not_whole_is_refused_and_leaves_nothing(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path
) -> None:
    target, new = tmp_path / "backup.zip", elsewhere("new")
    backups.backup(app.settings, target, STARTED)

    def damaged(damage: str) -> Path:
        def change(name: str, data: bytes) -> bytes | None:
            if name == backups.MANIFEST:
                said = json.loads(data)
                if damage == "rows":
                    said["rows"]["responses"] += 1
                elif damage == "format":
                    said["format"] = 2
                elif damage == "outside":
                    said["files"]["../outside"] = said["files"]["database"]
                return json.dumps(said).encode()
            if damage == "hash" and name.endswith(".mp4"):
                return data + b"\0"
            return None if damage == "missing" and name.endswith(".mp4") else data

        return rewritten(target, change)

    said = {
        "rows": "rows, got",
        "format": "format 1, got 2",
        "outside": "outside",
        "hash": "SHA-256",
        "missing": "a whole backup",
        "cut": "a whole backup",
    }
    for damage, expected in said.items():
        path = damaged(damage)
        if damage == "cut":
            path.write_bytes(target.read_bytes()[:-100])
        with pytest.raises(Exception, match=expected) as refused:
            backups.restore(path, new, [], STARTED)
        assert refused.type.__name__ in ("ConflictError", "UploadRefusedError")
        assert list(new.data_dir.iterdir()) == []
        assert rows_of(new.url) == {}
    assert not (tmp_path / "outside").exists()


@pytest.mark.parametrize("wrong", ["folder of videos", "a video", "ledger", "written ledger"])
def test_a_restore_that_fails_late_leaves_nothing_and_can_be_done_again(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path, wrong: str
) -> None:
    target, good = tmp_path / "backup.zip", elsewhere("new")
    backups.backup(app.settings, target, STARTED)
    withdrawal.withdraw_and_delete(app, people[0].token)
    in_the_way, diary = tmp_path / "in-the-way", tmp_path / "diary"
    diary.write_text("Dear diary\n")
    bad: dict[str, Path] = {"own_videos_dir": in_the_way}
    if wrong == "folder of videos":
        in_the_way.touch()
    elif wrong == "a video":
        # Found out after everything else was done.
        name = next(app.settings.uploads_dir.glob("*.mp4")).name
        (in_the_way / name / "something").mkdir(parents=True)
    elif wrong == "ledger":
        bad = {"deletions_file": diary}
    else:
        in_the_way.mkdir()
        bad = {"deletions_file": in_the_way}
    with pytest.raises((ConflictError, StoreAwayError)):
        backups.restore(target, good.model_copy(update=bad), ledger_of(app), STARTED)
    assert list(good.data_dir.iterdir()) == []
    assert rows_of(good.url) == {}
    assert backups.restore(target, good, ledger_of(app), STARTED).deleted_again == 1


def test_nobody_is_served_what_a_killed_restore_has_left(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path
) -> None:
    target, new = tmp_path / "backup.zip", elsewhere("new")
    backups.backup(app.settings, target, STARTED)
    restore = CONTEXT.Process(target=restore_and_be_killed, args=(target, new, os.environ["PATH"]))
    restore.start()
    restore.join(60)
    assert restore.exitcode == -signal.SIGKILL
    assert len(rows_of(new.url)["sessions"]) == 3
    with pytest.raises(ConflictError, match="did not finish"):
        open_app(new)
    with pytest.raises(ConflictError, match="did not finish"):
        backups.backup(new, tmp_path / "of-it.zip", STARTED)
    shutil.rmtree(new.data_dir)
    if new.database_url:
        with pytest.raises(ConflictError, match="did not finish"):
            backups.restore(target, new, [], STARTED)
        assert len(rows_of(new.url)["sessions"]) == 3


@pytest.mark.sqlite
def test_a_database_that_is_somebody_elses_is_left_alone(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path
) -> None:
    """PBPO_DATABASE_URL may name a file outside the folder that has to be empty."""
    target = tmp_path / "backup.zip"
    backups.backup(app.settings, target, STARTED)
    theirs = tmp_path / "theirs.sqlite3"
    theirs.write_bytes(b"theirs")
    new = elsewhere("new").model_copy(update={"database_url": f"sqlite:///{theirs}"})
    with pytest.raises(ConflictError, match="expected a new database"):
        backups.restore(target, new, [], STARTED)
    assert theirs.read_bytes() == b"theirs"


@pytest.mark.postgresql
def test_a_backup_of_postgresql_goes_into_an_empty_database_of_its_kind(
    app: AppContext, elsewhere: FitProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, new = tmp_path / "backup.zip", elsewhere("new")
    backups.backup(app.settings, target, STARTED)
    full = new.model_copy(update={"database_url": app.settings.url})
    with pytest.raises(ConflictError, match="expected an empty database"):
        backups.restore(target, full, [], STARTED)
    assert "studies" in rows_of(app.settings.url)
    in_sqlite = new.model_copy(update={"database_url": ""})
    with pytest.raises(ConflictError, match="a backup of a sqlite database"):
        backups.restore(target, in_sqlite, [], STARTED)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConflictError, match="expected pg_dump on this machine"):
        backups.backup(app.settings, tmp_path / "another.zip", STARTED)
