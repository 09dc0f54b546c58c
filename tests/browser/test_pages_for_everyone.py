"""Pages that few people see can be read by everybody too: no axe violation, light and dark."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository, revision
from app.storage.models.studies import SessionRow

from .evaluator import enter_small
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN
from .test_query_page import REASONS_PLAN

Serve = Callable[[str], Server]

AN_HOUR = "resume: {policy: resume, max_age_hours: 1}\n"


def expect_readable(page: Page, heading: str) -> None:
    expect(page.get_by_role("heading", level=1)).to_have_text(heading)
    assert violations(page, "light") == []
    assert violations(page, "dark") == []


@pytest.mark.parametrize("width", [360, 1280])
def test_what_is_kept_of_one(page: Page, serve: Serve, width: int) -> None:
    server = serve(SMALL_PLAN + "recruitment: {platform: prolific, codes: {completed: C1}}\n")
    page.set_viewport_size({"width": width, "height": 740})
    page.goto(f"{server.url}/s/small?PROLIFIC_PID=5f0c")
    page.get_by_test_id("privacy").click()
    expect_readable(page, "Your privacy")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    page.get_by_test_id("privacy-back").click()
    assert page.url.endswith("/s/small?PROLIFIC_PID=5f0c")


def test_left_for_too_long(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN + AN_HOUR)
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    with app.database.write() as db:
        db.query(SessionRow).one().last_seen_at -= timedelta(hours=1)
    app.close()
    page.reload()
    expect_readable(page, "You were away for too long")


def test_no_device_that_will_do(page: Page, serve: Serve) -> None:
    server = serve(SMALL_PLAN + "device_check: {test_clip: false, min_width_px: 1000}\n")
    page.set_viewport_size({"width": 360, "height": 740})
    page.goto(f"{server.url}/s/small")
    page.get_by_test_id("consent").click()
    expect(page.get_by_test_id("screen-out")).to_be_visible()
    expect_readable(page, "Is your device up to it?")
    page.get_by_test_id("screen-out").click()
    expect_readable(page, "Thank you for your interest")


def test_a_consent_that_is_asked_again(page: Page, serve: Serve, tmp_path: Path) -> None:
    server = serve(SMALL_PLAN)
    enter_small(page, f"{server.url}/s/small")
    folder = tmp_path / "study"
    (folder / "texts" / "en" / "consent.md").write_text("Answers are kept for ten years.\n")
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    revision.revise(app, repository.load_folder(str(folder)))
    app.close()
    page.reload()
    expect(page.get_by_text("This text has changed since you agreed to it.")).to_be_visible()
    expect_readable(page, "Before you take part")


def test_the_reasons_of_a_skip(page: Page, serve: Serve) -> None:
    server = serve(REASONS_PLAN)
    enter_small(page, f"{server.url}/s/small")
    page.get_by_test_id("skip").click()
    expect(page.get_by_role("group", name="Why do you skip this pair?")).to_be_visible()
    expect_readable(page, "Which video is better?")
