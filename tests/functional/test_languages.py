"""Evaluators' pages in the reader's language: all of the page, on every page, to the last one."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from html import unescape
from pathlib import Path

import httpx
import pytest
from babel.messages.pofile import read_po

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.study.folder import SHIPPED
from app.study.page_words import LOCALE
from tests.conftest import Clock, write_study

from .client import Api
from .test_participant_pages import heading, in_browser, version
from .test_welcome import TWO_LANGUAGES, language_of

#: What every page of these tests is asked for in.
JAPANESE = {"accept-language": "ja,en;q=0.5"}

PLAN = (
    TWO_LANGUAGES
    + """
device_check: {min_width_px: 300, min_mbit_s: 1}
practice: {queries: 1}
questionnaires: {end: [{name: age, type: number, label: {en: Age, ja: 年齢}}]}
contact: 木村, kimura@lab.example
"""
)


@pytest.fixture
def study(app: AppContext, tmp_path: Path) -> StudyInfo:
    """An open study in English and Japanese, with every stage there is."""
    folder = write_study(tmp_path / "study", PLAN)
    shutil.copytree(SHIPPED["waste-crane"] / "texts" / "ja", folder / "texts" / "ja")
    repository.create(app, repository.load_folder(str(folder)))
    return repository.open_study(app, "short")


def _forms(text: str | Sequence[str]) -> Sequence[str]:
    return (text,) if isinstance(text, str) else text


def english_in(page: httpx.Response) -> list[str]:
    """Our own English that the page shows, reads out, or has in its title.

    A text counts by its pieces of some length: what stands between the places in it.
    """
    with (LOCALE / "ja" / "LC_MESSAGES" / "pbpo.po").open("rb") as file:
        texts = [text for message in read_po(file) for text in _forms(message.id)]
    places = re.compile(r"<.*?>|%\(\w+\)s")
    pieces = {piece.strip() for text in texts for piece in places.split(text)}
    silent = r'<script.*?</script>|autocapitalize="\w+"'
    shown = unescape(re.sub(silent, "", page.text, flags=re.DOTALL))
    return sorted(piece for piece in pieces if len(piece) > 5 and piece in shown)


def assert_japanese(page: httpx.Response) -> None:
    assert language_of(page) == "ja"
    assert english_in(page) == []


HEADINGS = {
    "consent": "ご参加の前に",
    "device_check": "お使いの機器を確認します",
    "instructions": "行っていただくこと",
    "familiarisation": "動画に慣れましょう",
    "practice": "どちらの動画が良いですか",
    "query": "どちらの動画が良いですか",
    "break": "休憩してください",
    "questionnaire": "最後にいくつかお尋ねします",
    "debrief": "比較はすべて終わりました",
    "completed": "ありがとうございました",
    "withdrawn": "参加を終了しました",
    "declined": "承知しました",
}


@pytest.mark.parametrize("stage", HEADINGS)
def test_the_page_of_every_stage_is_in_the_language_of_the_session(
    client: Api, study: StudyInfo, clock: Clock, stage: str
) -> None:
    session = client.start(language="ja").to_stage(stage, clock.forward)
    client.cookies.set("pbpo_session_short", session.token)
    # What the browser asks for no longer counts: a session keeps its language.
    page = client.get("/s/short", headers={"accept-language": "en"})
    assert heading(page) == HEADINGS[stage]
    assert_japanese(page)
    assert 'class="languages"' not in page.text


def test_the_page_finds_nothing_english_only_where_there_is_nothing(
    client: Api, study: StudyInfo
) -> None:
    page = client.get("/s/short")
    assert language_of(page) == "en"
    assert "I agree and want to take part" in english_in(page)


def test_the_time_left_is_written_as_the_language_writes_it(
    client: Api, study: StudyInfo, clock: Clock
) -> None:
    session = client.start(language="ja").to_stage("break", clock.forward)
    client.cookies.set("pbpo_session_short", session.token)
    clock.forward(55)
    page = client.get("/s/short").text
    assert 'data-testid="countdown">1分05秒<' in page
    # The script that goes on counting has the same words with it.
    assert '"%(minutes)s:%(seconds)s": "%(minutes)s\\u5206%(seconds)s\\u79d2"' in page


def test_scripts_get_no_words_where_they_need_none(
    client: Api, study: StudyInfo, clock: Clock
) -> None:
    in_browser(client, "query", clock)
    assert 'id="words"' not in client.get("/s/short").text


def test_the_consent_comes_at_once_in_the_browsers_language_and_offers_the_other(
    client: Api, study: StudyInfo
) -> None:
    page = client.get("/s/short", headers=JAPANESE)
    assert heading(page) == HEADINGS["consent"]
    assert 'data-testid="consent"' in page.text
    header = page.text.partition("</header>")[0]
    assert re.findall(r'href="(\?lang=\w+)"', header) == ["?lang=en", "?lang=ja"]
    assert heading(client.get("/s/short?lang=en", headers=JAPANESE)) == "Before you take part"
    form = {"version": version(page)}
    assert client.post("/s/short/consent", data=form, headers=JAPANESE).status_code == 303
    assert language_of(client.get("/s/short")) == "ja"


@pytest.mark.parametrize(
    ("path", "status", "title"),
    [
        ("/s/short/delete", 200, "回答の削除"),
        ("/s/short/deleted", 200, "すべて削除しました"),
        ("/s/short/privacy", 200, "プライバシー"),
        ("/s/nowhere", 404, "ページが見つかりません"),
        ("/s/short/decline", 405, "今はこの操作ができません"),
    ],
)
def test_a_page_without_a_session_is_in_the_browsers_language(
    client: Api, study: StudyInfo, path: str, status: int, title: str
) -> None:
    page = client.get(path, headers=JAPANESE)
    assert (page.status_code, heading(page)) == (status, title)
    assert_japanese(page)


def test_what_is_refused_is_said_in_the_browsers_language(
    client: Api, app: AppContext, study: StudyInfo
) -> None:
    wrong = client.post("/s/short/delete", data={"receipt": "XXXX"}, headers=JAPANESE)
    assert "このコードで保存されているものはありません。" in wrong.text
    assert_japanese(wrong)
    declined = client.post("/s/short/decline", headers=JAPANESE)
    assert heading(declined) == HEADINGS["declined"]
    assert_japanese(declined)
    repository.close_study(app, "short")
    closed = client.get("/s/short", headers=JAPANESE)
    assert (closed.status_code, heading(closed)) == (409, "この調査は受付をしていません")
    assert_japanese(closed)


def test_answers_that_cannot_be_taken_are_named_in_the_language_of_the_session(
    client: Api, study: StudyInfo, clock: Clock
) -> None:
    session = client.start(language="ja").to_stage("questionnaire", clock.forward)
    client.cookies.set("pbpo_session_short", session.token)
    page = client.post("/s/short/questionnaire", data={"age": "old"})
    assert "未回答または読み取れない回答が1件あります。まだ何も保存されていません。" in page.text
    assert_japanese(page)


def test_whoever_leaves_without_a_trace_is_told_so_in_the_language_they_had(
    client: Api, study: StudyInfo
) -> None:
    session = client.start(language="ja").to_first_query()
    client.cookies.set("pbpo_session_short", session.token)
    gone = client.post("/s/short/withdraw", data={"delete": "yes"})
    page = client.get(gone.headers["location"])
    assert heading(page) == "すべて削除しました"
    assert_japanese(page)


def test_a_study_in_one_language_has_all_its_pages_in_that_one(
    client: Api, short_study: StudyInfo
) -> None:
    for path in ("/s/short", "/s/short/delete", "/s/short/deleted"):
        assert language_of(client.get(path, headers=JAPANESE)) == "en"


def test_the_shipped_study_begins_in_japanese_for_who_reads_it(
    client: Api, app: AppContext
) -> None:
    repository.create(app, repository.load_folder("waste-crane"))
    repository.open_study(app, "waste-crane")
    page = client.get("/s/waste-crane", headers=JAPANESE)
    assert "クレーンでごみをまく" in page.text
    assert 'data-testid="consent"' in page.text
    assert_japanese(page)
    assert heading(client.get("/s/waste-crane")) == "Before you take part"
