"""A backup taken while people answer, and what is made of it: the same but for deletions."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from sqlalchemy import delete

from app.main import create_app
from app.services import deletion_log
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import backups
from app.services.runtime.errors import ConflictError
from app.services.sessions import withdrawal
from app.services.studies import lifecycle, repository
from app.storage.models.studies import Identity
from tests.conftest import STARTED, Clock, Idle

from .backed_up import (
    PLATFORM_ID,
    FitProcess,
    begin_study,
    elsewhere,
    ledger_of,
    people,
    rows_of,
)
from .client import Api, Session
from .test_commands import Run, mistake, pbpo

__all__ = ["elsewhere", "pbpo", "people"]


def content(url: str) -> dict[str, list[str]]:
    """All that a database says, by table, but for the audit trail."""
    rows = rows_of(url)
    del rows["audit_events"]
    return {name: sorted(map(repr, found)) for name, found in rows.items()}


def test_a_backup_taken_in_use_becomes_the_same_studio(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path
) -> None:
    new = elsewhere("new")
    target = tmp_path / "backup.zip"
    with app.database.write() as writing:
        # Somebody's answer is being written just now: nobody waits, and half of it is in no backup.
        writing.execute(delete(Identity))
        held = backups.backup(app.settings, target, STARTED)
        writing.rollback()
    assert (held.rows["sessions"], held.rows["responses"], held.rows["identities"]) == (3, 9, 3)
    assert target.stat().st_mode & 0o777 == 0o600

    restored = backups.restore(target, new, [], STARTED)
    assert restored.deleted_again == 0
    # Production refuses to serve with one that others can read.
    assert new.deletion_log_path.stat().st_mode & 0o777 == 0o600
    assert content(new.url) == content(app.settings.url)
    was, came = (
        {path.name: path.read_bytes() for path in one.uploads_dir.iterdir()}
        for one in (app.settings, new)
    )
    assert was == came
    assert len(was) == 4

    # Who was half-way goes on, in the restored studio, at the query they were at.
    opened = open_app(new, now=app.now, background=Idle(1))
    assert opened.secret.key("forms") == app.secret.key("forms")
    with Api(create_app(app=opened)) as client:
        db = Session(client, people[1].token, people[1].state)
        assert db.look()["query"]["id"] == people[1].state["query"]["id"]
        assert db.respond("left").status_code == 200
    opened.close()


@pytest.mark.sqlite
def test_own_videos_in_a_folder_of_their_own_are_backed_up_and_restored_into_one(
    elsewhere: FitProcess, tmp_path: Path
) -> None:
    there = elsewhere("one").model_copy(update={"own_videos_dir": tmp_path / "videos"})
    one = open_app(there, background=Idle(1))
    begin_study(one, tmp_path / "kettles")
    one.close()
    assert not there.uploads_dir.exists()
    held = backups.backup(there, tmp_path / "backup.zip", STARTED)
    assert (held.files, held.elsewhere) == (4, 0)

    new = elsewhere("new").model_copy(update={"own_videos_dir": tmp_path / "new videos"})
    assert backups.restore(tmp_path / "backup.zip", new, [], STARTED).missing == 0
    was, came = (
        {path.name: path.read_bytes() for path in settings.own_videos.iterdir()}
        for settings in (there, new)
    )
    assert was == came
    assert list(new.uploads_dir.iterdir()) == []


def test_what_was_deleted_after_the_backup_is_deleted_again(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path, clock: Clock
) -> None:
    target, new = tmp_path / "backup.zip", elsewhere("new")
    backups.backup(app.settings, target, STARTED)
    clock.forward(48 * 3600)
    withdrawal.withdraw_and_delete(app, people[0].token)
    withdrawal.withdraw(app, people[2].token)  # before consent: their platform's id goes

    restored = backups.restore(target, new, ledger_of(app), clock.now())
    assert restored.deleted_again == 2
    found = rows_of(new.url)
    assert (len(found["sessions"]), len(found["responses"])) == (2, 1)
    assert [row["value"] for row in found["identities"]] == [f"{PLATFORM_ID}-1"]
    (stone,) = found["tombstones"]
    # On the day on which it was asked for.
    assert (stone["reason"], stone["stage"]) == ("wish", "completed")
    assert f"{stone['deleted_at']:%Y-%m-%d}" == "2026-03-03"
    if not new.database_url:
        assert f"{PLATFORM_ID}-0".encode() not in (new.data_dir / "pbpo.sqlite3").read_bytes()

    # The ledger goes on: an older backup, restored after this one, brings nobody back either. Nor
    # does one that is restored beside it, whatever ledger is named.
    again = elsewhere("again").model_copy(update={"deletions_file": new.deletion_log_path})
    assert backups.restore(target, again, [], clock.now()).deleted_again == 2


def test_a_study_deleted_after_the_backup_is_deleted_again_and_one_of_its_name_is_not(
    people: list[Session], app: AppContext, elsewhere: FitProcess, tmp_path: Path, clock: Clock
) -> None:
    settings = {name: elsewhere(name) for name in ("before", "after")}
    backups.backup(app.settings, tmp_path / "before.zip", STARTED)
    repository.close_study(app, "kettles")
    lifecycle.delete(app, "kettles", typed="kettles")
    clock.forward(60)
    begin_study(app, tmp_path / "kettles-again")
    backups.backup(app.settings, tmp_path / "after.zip", STARTED)

    for name, deleted, left in (("before", 1, 0), ("after", 0, 1)):
        restored = backups.restore(
            tmp_path / f"{name}.zip", settings[name], ledger_of(app), clock.now()
        )
        assert restored.deleted_again == deleted
        found = rows_of(settings[name].url)
        assert (len(found["studies"]), len(found["sessions"])) == (left, 0)


def test_the_ledger_says_nothing_of_whom_it_is_about(
    people: list[Session], app: AppContext
) -> None:
    withdrawal.withdraw_and_delete(app, people[0].token)
    path = app.settings.deletion_log_path
    text = path.read_text()
    assert text.startswith("2026-03-01 wish ")
    assert len(text.splitlines()) == 1
    assert path.stat().st_mode & 0o777 == 0o600
    for told in (people[0].token, PLATFORM_ID, "kettles"):
        assert told not in text


def test_nothing_is_deleted_that_could_not_be_noted(people: list[Session], app: AppContext) -> None:
    """Better a deletion that is asked for once more than one that a backup brings back."""
    app.settings.deletion_log_path.mkdir()
    with pytest.raises(IsADirectoryError):
        withdrawal.withdraw_and_delete(app, people[0].token)
    assert people[0].look()["stage"] == "completed"


def test_half_a_line_is_passed_over_and_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deletions.log"
    kept = deletion_log.DeletionLog(path)
    kept.append(STARTED, deletion_log.WISH, ["a" * 64])
    for torn in ("2026-03-0", "2026-03-01 wi", "2026-03-01 wish 0a3"):
        with path.open("a") as file:
            file.write(torn)
        kept.append(STARTED, deletion_log.RETENTION, ["b" * 64])
    found = [(line.what, line.key[0]) for line in deletion_log.read(path)]
    assert found == [("wish", "a"), *[("retention", "b")] * 3]
    path.write_text("Dear diary\n")
    with pytest.raises(ConflictError, match=r"deletions\.log:1: expected a day"):
        deletion_log.read(path)


@pytest.mark.sqlite
def test_what_killed_backups_have_left_is_thrown_away_after_a_day(
    app: AppContext, tmp_path: Path
) -> None:
    ages = {".pbpo-backup-old": 25, ".pbpo-backup-under-way": 1, "pbpo-of-old.zip": 1000}
    for name, hours in ages.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "database").write_bytes(b"everybody")
        at = STARTED.timestamp() - hours * 3600
        for path in (tmp_path / name / "database", tmp_path / name):
            os.utime(path, (at, at))
    backups.backup(app.settings, tmp_path / "backup.zip", STARTED)
    assert {name for name in ages if (tmp_path / name).exists()} == ages.keys() - {
        ".pbpo-backup-old"
    }
    assert not list(tmp_path.glob(".pbpo-backup-*/backup.zip"))


@pytest.mark.sqlite
def test_by_command(people: list[Session], app: AppContext, pbpo: Run, tmp_path: Path) -> None:
    target = tmp_path / "backup.zip"
    said = pbpo("backup", "--out", target, "--data-dir", app.settings.data_dir)
    assert said.status == 0, said
    assert "sessions: 3, responses: 9, files besides: 4" in said.out
    again = mistake(pbpo("backup", "--out", target, "--data-dir", app.settings.data_dir))
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
