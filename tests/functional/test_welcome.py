"""What comes before the consent: a welcome, and the choice of a language."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.study.page_words import own_name
from app.web.http.languages import preferred
from tests.conftest import SHORT_PLAN, write_study

from .client import Api
from .test_participant_pages import heading, kept, sent_on, version

TWO_LANGUAGES = (
    SHORT_PLAN.replace("languages: [en]", "languages: [en, ja]")
    .replace("{en: A short study}", "{en: A short study, ja: 短い研究}")
    .replace("label: {en: I don't like either.}", "label: {en: Neither, ja: どちらも}")
    .replace("label: {en: It's hard to choose.}", "label: {en: Hard, ja: 難しい}")
    .replace("label: Opening time, ", "")
    .replace("label: Closing time, ", "")
    .replace("label: Clumps, ", "")
)


@pytest.fixture
def welcoming_study(app: AppContext, tmp_path: Path) -> StudyInfo:
    """An open study in two languages with a welcome in both."""
    folder = write_study(tmp_path / "study", TWO_LANGUAGES)
    (folder / "texts" / "en" / "welcome.md").write_text("How nice that you came.\n")
    (folder / "texts" / "ja").mkdir()
    for text in (folder / "texts" / "en").iterdir():
        japanese = f"日本語の{text.stem}。\n"
        (folder / "texts" / "ja" / text.name).write_text(japanese, encoding="utf-8")
    repository.create(app, repository.load_folder(str(folder)))
    return repository.open_study(app, "short")


def language_of(page: httpx.Response) -> str:
    found = re.search(r'<html lang="(\w+)"', page.text)
    assert found
    return found[1]


def test_the_welcome_comes_before_the_consent_and_keeps_nothing(
    client: Api, welcoming_study: StudyInfo, api_token: str
) -> None:
    page = client.get("/s/short?x=1")
    assert heading(page) == "Welcome"
    assert "How nice that you came." in page.text
    assert 'href="/s/short/consent?x=1"' in page.text
    consent = client.get("/s/short/consent?x=1")
    assert heading(consent) == "Before you take part"
    assert "set-cookie" not in consent.headers
    assert kept(client, api_token) == 0
    sent_on(client.post("/s/short/consent?x=1", data={"version": version(consent)}))
    assert heading(client.get("/s/short")) == "What you will do"
    sent_on(client.get("/s/short/consent"))


def test_a_language_chosen_on_the_page_stays_through_the_session(
    client: Api, welcoming_study: StudyInfo
) -> None:
    page = client.get("/s/short?x=1")
    links = dict(re.findall(r'<a href="(\?[^"]+)" lang="(\w+)"', page.text))
    assert {code: link for link, code in links.items()} == {
        "en": "?x=1&amp;lang=en",
        "ja": "?x=1&amp;lang=ja",
    }
    japanese = client.get("/s/short/consent?x=1&lang=ja")
    assert language_of(japanese) == "ja"
    assert "日本語のconsent" in japanese.text
    client.post("/s/short/consent?x=1&lang=ja", data={"version": version(japanese)})
    assert "日本語のinstructions" in client.get("/s/short").text


@pytest.mark.parametrize(
    ("link", "accepted", "language"),
    [
        ("", "ja,en;q=0.5", "ja"),
        ("", "fr-FR,fr;q=0.9", "en"),
        ("?lang=en", "ja", "en"),
        ("?lang=xx", "ja", "ja"),
        ("", "", "en"),
    ],
)
def test_the_link_names_the_language_or_else_the_browser_does(
    client: Api, welcoming_study: StudyInfo, link: str, accepted: str, language: str
) -> None:
    page = client.get(f"/s/short{link}", headers={"accept-language": accepted})
    assert language_of(page) == language


def test_the_api_takes_the_language_at_the_start(client: Api, welcoming_study: StudyInfo) -> None:
    assert "日本語のconsent" in client.start(language="ja").state["consent"]["html"]
    assert client.start(language="fr").state["language"] == "en"


def test_a_study_in_one_language_without_a_welcome_begins_with_the_consent(
    client: Api, short_study: StudyInfo
) -> None:
    page = client.get("/s/short", headers={"accept-language": "ja"})
    assert heading(page) == "Before you take part"
    assert 'class="languages"' not in page.text


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("en;q=0.4, ja;q=0.8", "ja"),
        ("de", None),
        ("EN-gb", "en"),
        ("ja;q=x, en", "en"),
        (",;=,", None),
    ],
)
def test_what_a_browser_accepts_is_read_with_its_weights(
    accepted: str, language: str | None
) -> None:
    assert preferred(accepted, ["en", "ja"]) == language


def test_a_language_is_called_what_its_speakers_call_it() -> None:
    assert [own_name(code) for code in ("ja", "pt-BR", "tlh")] == [
        "日本語",
        "Português (Brasil)",
        "tlh",
    ]
