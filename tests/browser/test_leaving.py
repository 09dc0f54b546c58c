"""Leaving in a real browser: what is offered, what it does, and that everybody can read it."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing

import pytest
from playwright.sync_api import BrowserContext, Page, expect

from .evaluator import answer, enter
from .for_everyone import violations
from .server import Server


def rows(server: Server, table: str) -> int:
    with closing(sqlite3.connect(server.data_dir / "pbpo.sqlite3")) as database:
        number: int = database.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
    return number


def test_whoever_stops_and_deletes_leaves_nothing_behind(server: Server, page: Page) -> None:
    enter(page, f"{server.url}/s/short")
    answer(page, "left", by="button")
    assert rows(server, "responses") == 1
    page.get_by_test_id("withdraw").click()
    expect(page.get_by_test_id("withdraw-delete-open")).to_be_visible()
    assert violations(page) == []
    # Deletion lies behind a step of its own: one press alone destroys nothing.
    expect(page.get_by_test_id("withdraw-delete")).to_be_hidden()
    page.get_by_test_id("withdraw-delete-open").click()
    expect(page.get_by_test_id("withdraw-delete")).to_be_visible()
    assert violations(page) == []
    page.get_by_test_id("withdraw-delete").click()
    expect(page.get_by_role("heading", name="Everything is deleted")).to_be_visible()
    assert violations(page) == []
    assert [rows(server, table) for table in ("participants", "sessions", "responses")] == [0] * 3
    assert rows(server, "tombstones") == 1
    page.go_back()
    expect(page.get_by_role("heading", name="Before you take part")).to_be_visible()


@pytest.mark.parametrize("width", [360, 1280])
def test_a_receipt_deletes_from_another_browser(
    server: Server, page: Page, context: BrowserContext, width: int
) -> None:
    page.set_viewport_size({"width": width, "height": 740})
    page.goto(f"{server.url}/s/short")
    page.get_by_test_id("consent").click()
    receipt = page.get_by_test_id("receipt").inner_text()
    delete_url = page.get_by_test_id("delete-link").inner_text()
    assert re.fullmatch(rf"{server.url}/s/short/delete", delete_url)
    assert violations(page) == []

    context.clear_cookies()
    page.goto(delete_url)
    page.get_by_label("Receipt code").fill("not this one")
    page.get_by_test_id("delete-find").click()
    expect(page.get_by_role("alert")).to_contain_text("Nothing is kept under this code")
    assert violations(page) == []
    page.get_by_label("Receipt code").fill(receipt.lower().replace("-", " "))
    page.get_by_label("Receipt code").press("Enter")
    # One press alone deletes nothing.
    expect(page.get_by_test_id("delete-back")).to_be_visible()
    assert violations(page) == []
    assert rows(server, "participants") == 1
    page.get_by_test_id("delete-confirm").click()
    expect(page.get_by_role("heading", name="Everything is deleted")).to_be_visible()
    assert rows(server, "participants") == 0
