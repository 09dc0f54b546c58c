"""A whole session in Japanese, on a phone's width and by the keyboard alone."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from .evaluator import answer, watch
from .for_everyone import violations
from .server import Server
from .small_study import BILINGUAL_PLAN

PLAN = (
    BILINGUAL_PLAN.replace(
        "queries_per_trial: 4", "queries_per_trial: 1\ntrials_per_condition: 2"
    ).replace("break_s: 0", "break_s: 4")
    + """
device_check: {test_clip: true, min_width_px: 300, min_mbit_s: 0.01}
familiarisation: {videos: 2, required: 1, speeds: [1, 4]}
practice: {queries: 1}
questionnaires:
  end:
    - {name: age, type: number, min: 18, label: {en: "How old are you?", ja: 年齢}}
    - name: effort
      type: likert
      points: 5
      label: {en: "How hard was it?", ja: 選ぶのは難しかったですか。}
      labels: [{en: Easy, ja: 易しかった}, {en: Hard, ja: 難しかった}]
"""
)


#: A receipt's code; then names, and what stands in the receipt's address.
CODE = re.compile(r"\b\w{4}(-\w{4}){3}\b")
NOT_OURS = {"English", "Space", "http", "small", "delete"}


@pytest.fixture
def phone(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 360, "height": 740}, locale="ja-JP")
    yield context.new_page()
    context.close()


def look(page: Page, heading: str) -> None:
    """The page is this one, in Japanese throughout, fits the width, and has no axe violation."""
    expect(page.get_by_role("heading", level=1)).to_have_text(heading)
    assert page.locator("html").get_attribute("lang") == "ja"
    # What scripts write stands there too.
    said = CODE.sub("", page.locator("body").inner_text() + page.title())
    assert [word for word in re.findall(r"[A-Za-z]{3,}", said) if word not in NOT_OURS] == []
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    assert violations(page, "light") == [], heading
    assert violations(page, "dark") == [], heading


def press(page: Page, hook: str) -> None:
    """Go to the control by Tab alone, and press Enter."""
    expect(page.get_by_test_id(hook)).to_be_enabled()
    for _ in range(40):
        page.keyboard.press("Tab")
        focused = page.evaluate("document.activeElement.dataset.testid")
        if focused == hook:
            page.keyboard.press("Enter")
            return
    raise AssertionError(f"expected to reach {hook} by Tab")


def test_a_session_in_japanese_by_the_keyboard(phone: Page, serve: Callable[[str], Server]) -> None:
    server = serve(PLAN)
    phone.goto(f"{server.url}/s/small")
    look(phone, "ご参加の前に")
    expect(phone.get_by_role("link", name="English")).to_be_visible()
    press(phone, "consent")

    expect(phone.get_by_test_id("continue")).to_be_enabled()
    look(phone, "お使いの機器を確認します")
    press(phone, "continue")
    look(phone, "行っていただくこと")
    press(phone, "continue")

    expect(phone.get_by_test_id("watched")).to_contain_text("視聴済み 1本、残り 1本")
    look(phone, "動画に慣れましょう")
    press(phone, "continue")

    watch(phone)
    expect(phone.get_by_test_id("progress")).to_have_text("練習 · ペア 1 / 1")
    look(phone, "どちらの動画が良いですか")
    answer(phone, "left", by="key")
    watch(phone)
    expect(phone.get_by_test_id("progress")).to_have_text("パート 1 / 2 · ペア 1 / 1")
    answer(phone, "skip", by="key")

    expect(phone.get_by_test_id("countdown")).to_have_text(re.compile(r"^0分0\d秒$"))
    look(phone, "休憩してください")
    press(phone, "withdraw")
    look(phone, "参加をやめますか")
    press(phone, "withdraw-back")
    expect(phone.get_by_test_id("continue")).to_be_enabled()
    press(phone, "continue")

    watch(phone)
    answer(phone, "right", by="key")
    look(phone, "最後にいくつかお尋ねします")
    press(phone, "continue")
    expect(phone.get_by_role("alert")).to_contain_text(
        "未回答または読み取れない回答が2件あります。"
    )
    look(phone, "最後にいくつかお尋ねします")
    phone.get_by_label("年齢").fill("30")
    phone.get_by_role("radio", name="1 易しかった").press("Space")
    press(phone, "continue")
    look(phone, "比較はすべて終わりました")
    press(phone, "continue")
    look(phone, "ありがとうございました")
