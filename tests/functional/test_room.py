"""Room on the disk and for each account: asked for before anything large is taken."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from app.services import jobs
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.drafts import drafts, transcode_job
from app.services.maintenance import backups
from app.services.runtime import disk_quota
from app.services.runtime.errors import NoRoomError
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import SHORT_PLAN, Clock, write_study

from .client import Api
from .desk import Desk
from .test_hostile_uploads import packed


class Usage(NamedTuple):
    total: int
    used: int
    free: int


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(
        update={"drafts_per_account": 3, "account_limit_mb": 2, "upload_limit_mb": 1}
    )


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def disk(monkeypatch: pytest.MonkeyPatch, total: float, free: float) -> None:
    usage = Usage(int(total), int(total - free), int(free))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)


@pytest.mark.parametrize(
    ("total", "free", "coming", "fits"),
    [
        (100e9, 5.1e9, 0, True),
        (100e9, 4.9e9, 0, False),
        (100e9, 6e9, 2e9, False),
        (10e9, 1.1e9, 0, True),
        (10e9, 0.9e9, 0, False),
    ],
)
def test_five_gigabytes_or_a_tenth_stay_free(
    settings: Settings,
    monkeypatch: pytest.MonkeyPatch,
    total: float,
    free: float,
    coming: float,
    fits: bool,
) -> None:
    disk(monkeypatch, total, free)
    folder = settings.uploads_dir / "not" / "there"
    if fits:
        disk_quota.require(settings, folder, int(coming))
    else:
        with pytest.raises(NoRoomError, match="free on the server's disk"):
            disk_quota.require(settings, folder, int(coming))
    disk_quota.require(settings.model_copy(update={"keep_free_gb": 0}), folder)


def test_on_a_full_disk_nothing_large_is_begun_and_the_page_says_why(
    desk: Desk, app: AppContext, tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = desk.begin({}, name="There")
    draft = drafts.find(app, desk.account, here.rpartition("/")[2])
    folder = repository.load_folder(str(write_study(tmp_path / "s", SHORT_PLAN)))
    disk(monkeypatch, 100e9, 1e9)
    for path in ("/drafts", f"{here}/files"):
        answer = desk.send(path, {"a.txt": b"x"})
        assert (answer.status_code, "free on the server" in answer.text) == (422, True)
    for ask in (
        lambda: drafts.begin(app, desk.account, "Another"),
        lambda: repository.create(app, folder),
        lambda: jobs.enqueue(app, desk.account, transcode_job.KIND, {"draft": draft.public_id}),
        lambda: backups.backup(app.settings, tmp_path / "backup.zip", clock.now()),
    ):
        with pytest.raises(NoRoomError):
            ask()
    # What is there can be looked at, written and thrown away.
    assert desk.get(here).status_code == 200
    assert desk.post(f"{here}/text", file="notes.txt", text="x").status_code == 303
    assert desk.post(f"{here}/discard").status_code == 303


def test_an_account_makes_so_many_studies_at_a_time(desk: Desk, app: AppContext) -> None:
    addresses = [desk.begin({}, name=f"Number {number}") for number in range(3)]
    answer = desk.send("/drafts", {"a.txt": b"x"}, name="One more")
    assert (answer.status_code, "at most 3 studies" in answer.text) == (422, True)
    assert len(drafts.list_drafts(app, desk.account)) == 3
    assert desk.post(f"{addresses[0]}/discard").status_code == 303
    desk.begin({}, name="One more")


def test_all_that_an_account_is_making_has_one_limit(
    desk: Desk, client: Api, app: AppContext
) -> None:
    for number in range(2):
        desk.begin({"a.mp4": bytes(900_000)}, name=f"Number {number}")
    answer = desk.send("/drafts", {"a.mp4": bytes(900_000)})
    assert answer.status_code == 422
    assert "a.mp4 is more" in answer.text
    other = Desk(client, app, "other@lab.example", Role.EXPERIMENTER)
    other.begin({"a.mp4": bytes(900_000)}, name="Somebody else's")


def test_a_zip_is_no_bomb_as_a_whole_either(
    desk: Desk, app: AppContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each file packs well below the size from which its own ratio is asked for."""
    larger = app.settings.model_copy(update={"upload_limit_mb": 4000, "account_limit_mb": 12000})
    object.__setattr__(app, "settings", larger)
    bomb = packed(*((f"videos/{number}.mp4", bytes(999_999)) for number in range(30)))
    assert len(bomb) < 60_000
    answer = desk.send("/drafts", {"bomb.zip": bomb})
    assert (answer.status_code, "pack" in answer.text) == (422, True)
    assert [path for path in app.settings.uploads_dir.rglob("*") if path.is_file()] == []
