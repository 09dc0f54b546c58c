"""Pages from right to left: words run the other way, the left video stays on the left."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.own_words import SOME_ARABIC, write_arabic_texts

from .evaluator import answer, watch
from .for_everyone import violations
from .forked import ForkedServer
from .server import Server
from .small_study import SMALL_PLAN, write_small_study
from .test_layout import WIDTHS, box, expect_no_scrolling_sideways

PICTURES = os.environ.get("PBPO_TEST_PICTURES")
PLAN = (
    SMALL_PLAN.replace("languages: [en]", "languages: [ar]")
    .replace("queries_per_trial: 4", "queries_per_trial: 1")
    .replace("title: Small", "title: دراسة صغيرة")
    .replace("I don't like either.", "كلاهما سيئ")
    + """
questionnaires:
  end:
    - {name: effort, type: likert, points: 5, label: ما مدى الصعوبة؟, labels: [سهل, صعب]}
    - {name: age, type: number, min: 18, label: كم عمرك؟}
"""
)


@pytest.fixture(params=[True, False], ids=["own words", "English words"])
def arabic(
    request: pytest.FixtureRequest, tmp_path: Path, media_dir: Path
) -> Iterator[tuple[Server, bool]]:
    """A server with an open study in Arabic, and whether it brings the words of the pages."""
    folder = write_small_study(tmp_path / "study", PLAN)
    shutil.rmtree(folder / "texts")
    write_arabic_texts(folder, own_words=request.param)
    app = open_app(Settings(data_dir=tmp_path / "data", media_dir=media_dir))
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "small")
    app.close()
    server = ForkedServer(tmp_path / "data", media_dir)
    server.start()
    yield server, request.param
    server.kill()


def look(page: Page, name: str, *, own_words: bool) -> None:
    """It is laid out from right to left, fits every width, and has no axe violation."""
    html, body = page.locator("html"), page.locator("body")
    expect(html).to_have_attribute("lang", "ar")
    expect(html).to_have_attribute("dir", "rtl")
    if own_words:
        assert body.get_attribute("lang") is None
    else:
        expect(body).to_have_attribute("lang", "en")
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        expect_no_scrolling_sideways(page, width)
        if PICTURES:
            page.screenshot(path=f"{PICTURES}/rtl-{own_words}-{name}-{width}.png")
    assert violations(page) == []


def test_a_session_in_arabic(page: Page, arabic: tuple[Server, bool]) -> None:
    server, own_words = arabic
    page.goto(f"{server.url}/s/small")
    expect(page.locator(".prose li").first).to_have_text("أولاً")
    assert page.locator(".prose").evaluate("(one) => getComputedStyle(one).direction") == "rtl"
    assert page.locator(".prose").get_attribute("lang") == (None if own_words else "ar")
    look(page, "consent", own_words=own_words)
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    watch(page)
    page.set_viewport_size({"width": 1280, "height": 900})
    for left, right in (("video-left", "video-right"), ("answer-left", "answer-right")):
        boxes = [box(page, f'[data-testid="{name}"]') for name in (left, right)]
        assert boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"]
    said = page.get_by_test_id("answer-left").inner_text()
    assert (SOME_ARABIC in said) is own_words
    assert ("Left is better" in said) is not own_words
    look(page, "query", own_words=own_words)
    answer(page, "left", by="key")
    page.get_by_test_id("continue").click()
    expect(page.locator("#fault-age")).to_be_visible()
    look(page, "questions", own_words=own_words)
