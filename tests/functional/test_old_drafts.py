"""Studies being made that nobody goes on with are thrown away, and their page says when."""

from __future__ import annotations

import os
import re
from datetime import timedelta

import pytest

from app.services.accounts import audit_log
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.maintenance import expired_drafts, periodic_tasks
from tests.conftest import Clock

from .client import Api
from .desk import Desk

DAY = 24 * 3600.0


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def test_a_draft_is_thrown_away_after_days_without_a_change(
    desk: Desk, app: AppContext, clock: Clock
) -> None:
    # For longer than a sign-in lasts: what is there is asked of the service.
    begun = drafts.begin(app, desk.account, "Old")
    changed = drafts.begin(app, desk.account, "New")
    clock.forward(30 * DAY)
    drafts.write_text(app, changed, "notes.txt", "still at it")
    clock.forward(30 * DAY - 1)
    assert expired_drafts.delete_expired(app) == 0
    clock.forward(1)
    periodic_tasks.run_all(app)
    assert [draft.name for draft in drafts.list_drafts(app, desk.account)] == ["New"]
    assert not begun.folder.exists()
    assert drafts.text_of(changed, "notes.txt") == "still at it"
    line = audit_log.trail(app)[0]
    assert (line.actor, line.action) == ("retention rule", "old draft removed")
    assert line.details == {"draft": begun.public_id}


def test_its_page_says_until_when_it_is_kept(desk: Desk, clock: Clock) -> None:
    here = desk.begin({"notes.txt": b"x"})
    page = desk.get(here).text
    [told] = re.findall(r'data-testid="kept-until">(.*?)</p>', page)
    # 60 days after the first of March.
    assert "2026-04-30" in told
    assert "for 60 days" in told
    clock.forward(DAY)
    assert desk.post(f"{here}/text", file="notes.txt", text="y").status_code == 303
    assert "2026-05-01" in desk.get(here).text


def test_the_days_are_a_setting_and_a_sweep_can_be_stopped(
    desk: Desk, app: AppContext, clock: Clock
) -> None:
    settings = app.settings.model_copy(update={"drafts_kept_days": 3})
    object.__setattr__(app, "settings", settings)
    for name in ("one", "two"):
        drafts.begin(app, desk.account, name)
    clock.forward(3 * DAY)
    asked = iter([False, True, True])
    assert expired_drafts.delete_expired(app, lambda: next(asked)) == 1
    assert expired_drafts.delete_expired(app) == 1


def test_a_folder_of_an_upload_that_was_cut_off_is_removed_and_one_under_way_stays(
    desk: Desk, app: AppContext, clock: Clock
) -> None:
    kept = drafts.begin(app, desk.account, "Kept").folder
    for name, age in (("cut-off", timedelta(days=2)), ("under-way", timedelta(hours=1))):
        folder = drafts.folder_of(app, name)
        folder.mkdir()
        (folder / "a.mp4").write_bytes(b"x")
        at = (clock.now() - age).timestamp()
        os.utime(folder, (at, at))
    assert expired_drafts.delete_expired(app) == 1
    assert sorted(path.name for path in kept.parent.iterdir()) == sorted([kept.name, "under-way"])
