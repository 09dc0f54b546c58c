"""The questionnaire page: keeps what is typed, says what is wrong, and reads right on a phone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.storage.models.studies import QuestionnaireAnswer

from .conftest import serving
from .for_everyone import violations
from .server import Server
from .small_study import SMALL_PLAN
from .test_numbers import to_the_questions

PLAN = (
    SMALL_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 1")
    + """
questionnaires:
  after_trial:
    - {name: recommend, type: likert, points: 11, label: "Would you recommend it?",
       labels: [Not at all likely, Extremely likely]}
    - {name: mood, type: likert, points: 7, label: "How are you?", labels: [Bad, Good]}
    - {name: age, type: number, min: 18, max: 120, label: "How old are you?"}
    - {name: remarks, type: text, label: "Anything else?", required: false}
"""
)

#: Where each point of a scale stands, and the label of an end if it is in sight.
POINTS = """(name) => [...document.getElementsByName(name)].map((input) => {
    const label = input.closest("label");
    const end = label.querySelector(".end-label");
    const { top, left } = label.getBoundingClientRect();
    return [top, left, end && end.getBoundingClientRect().width > 5 ? end.textContent : ""];
})"""

#: Fits by what browsers count, and neither by bytes, code points nor what a form sends.
LONGEST = "\n".join(["x"] * 900) + "\U0001f600" * 100 + "y"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, media_dir: Path) -> Iterator[Server]:
    server = serving(tmp_path_factory.mktemp("asking"), media_dir, PLAN)
    yield server
    server.kill()


@pytest.fixture
def page(browser: Browser, server: Server) -> Iterator[Page]:
    """The page of the questions on a narrow phone, in a session of its own."""
    with httpx.Client(base_url=f"{server.url}/api/v1", timeout=60) as client:
        token = to_the_questions(client, "en")
    context = browser.new_context(viewport={"width": 320, "height": 640}, has_touch=True)
    context.add_cookies([{"name": "pbpo_session_small", "value": token, "url": server.url}])
    page = context.new_page()
    page.goto(f"{server.url}/s/small")
    yield page
    context.close()


def test_what_is_typed_stays_until_it_is_sent(page: Page, server: Server) -> None:
    remarks = page.get_by_label("Anything else?")

    def expect_all_there() -> None:
        expect(remarks).to_have_value(LONGEST)
        expect(page.locator('[name="mood"][value="6"]')).to_be_checked()

    page.locator('[name="mood"][value="6"]').check()
    assert len(LONGEST.encode("utf-16-le")) // 2 == 2000
    remarks.fill(LONGEST)
    expect(page.get_by_text("The field is full").first).to_be_visible()
    page.reload()
    expect_all_there()
    page.get_by_test_id("privacy").click()
    page.get_by_test_id("privacy-back").click()
    expect_all_there()
    page.get_by_test_id("withdraw").click()
    page.get_by_test_id("withdraw-back").click()
    expect_all_there()
    page.get_by_test_id("privacy").click()
    page.go_back()
    expect_all_there()

    page.locator('[name="recommend"][value="10"]').check()
    page.get_by_label("How old are you?").fill("40")
    page.get_by_test_id("continue").click()
    expect(remarks).to_have_count(0)
    page.wait_for_function(
        "() => !Object.keys(sessionStorage).some((key) => key.includes('typed'))"
    )
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    with app.database.read() as db:
        assert db.query(QuestionnaireAnswer).filter_by(item="remarks").one().value == LONGEST
    app.close()


def test_what_is_wrong_is_summed_up_and_leads_to_its_field(page: Page) -> None:
    page.get_by_label("How old are you?").fill("12")
    page.get_by_test_id("continue").click()
    summary = page.get_by_test_id("fault-summary")
    expect(summary).to_be_focused()
    expect(page).to_have_title("Error: Some questions · Small")
    assert summary.get_by_role("link").all_inner_texts() == [
        "Would you recommend it?",
        "How are you?",
        "How old are you?",
    ]
    assert violations(page, "light") == []
    assert violations(page, "dark") == []
    summary.get_by_role("link", name="How old are you?").click()
    age = page.get_by_label("How old are you?")
    expect(age).to_be_focused()
    expect(age).to_have_accessible_description(
        "A number from 18 to 120 Please give a number from 18 to 120."
    )
    summary.get_by_role("link", name="Would you recommend it?").click()
    expect(page.locator('[name="recommend"]').first).to_be_focused()


def test_scales_read_right_on_a_phone(page: Page) -> None:
    for width in (320, 360):
        page.set_viewport_size({"width": width, "height": 640})
        tops, lefts, ends = zip(*page.evaluate(POINTS, "recommend"), strict=True)
        assert list(tops) == sorted(set(tops))
        assert len(set(lefts)) == 1
        assert ends == ("Not at all likely", *[""] * 9, "Extremely likely")
        assert len({top for top, _, _ in page.evaluate(POINTS, "mood")}) == 1
        assert page.evaluate("document.documentElement.scrollWidth") == width
