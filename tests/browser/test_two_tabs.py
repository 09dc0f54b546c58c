"""A draft in two tabs, and uploads without scripts: seen in a real browser."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Browser, Page, expect

from .conftest import EMAIL, PASSWORD
from .server import Server


def sign_in(page: Page, server: Server) -> None:
    page.goto(f"{server.url}/sign-in")
    page.locator("input[name=email]").fill(EMAIL)
    page.locator("input[name=password]").fill(PASSWORD)
    page.locator("main button").first.click()
    expect(page).to_have_url(f"{server.url}/studies")


def test_what_two_tabs_write_is_shown_side_by_side(page: Page, server: Server) -> None:
    sign_in(page, server)
    page.goto(f"{server.url}/studies/short/texts")
    other = page.context.new_page()
    other.goto(f"{server.url}/studies/short/texts")
    for tab, words in ((page, "The first tab's consent."), (other, "The second tab's consent.")):
        tab.get_by_test_id("text-en-consent").fill(words)
        tab.get_by_test_id("save-texts").click()
    expect(page).to_have_url(f"{server.url}/studies/short/plan")
    expect(other.get_by_test_id("changed-meanwhile")).to_be_visible()
    expect(other.get_by_test_id("difference")).to_contain_text("stored The first tab's consent.")
    expect(other.get_by_test_id("text-en-consent")).to_have_value("The second tab's consent.")
    for width in (360, 1440):
        other.set_viewport_size({"width": width, "height": 900})
        assert other.evaluate("document.documentElement.scrollWidth <= innerWidth")
    other.get_by_test_id("save-texts").click()
    expect(other).to_have_url(f"{server.url}/studies/short/plan")


def test_files_are_sent_without_scripts_too(
    browser: Browser, server: Server, tmp_path: Path
) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    sign_in(page, server)
    (tmp_path / "notes.txt").write_text("x" * 200_000)
    page.goto(f"{server.url}/studies/new")
    page.get_by_test_id("draft-name").fill("Without scripts")
    page.get_by_test_id("draft-files").set_input_files(tmp_path / "notes.txt")
    page.get_by_test_id("begin-draft").click()
    expect(page.locator("main")).to_contain_text("notes.txt")
    # A form of an ended sign-in is refused in words, however much it brings.
    page.goto(f"{server.url}/studies/new")
    (tmp_path / "big.mp4").write_bytes(bytes(8_000_000))
    page.get_by_test_id("draft-files").set_input_files(tmp_path / "big.mp4")
    page.locator("main input[name=csrf_token]").evaluate("one => one.value = 'old'")
    page.get_by_test_id("begin-draft").click()
    expect(page.locator("main")).to_contain_text("this form is out of date")
    context.close()
