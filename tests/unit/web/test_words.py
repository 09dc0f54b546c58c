"""What our pages say is said in every language that they speak, and says the same."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from babel.messages.catalog import Catalog, Message
from babel.messages.frontend import CommandLineInterface
from babel.messages.pofile import read_po

from app.study import page_words
from app.web.http import translations
from app.web.http.templating import ROOT, environment_in
from app.web.http.translations import Wording

LANGUAGES = page_words.available_locales()[1:]
PLACE = re.compile(r"%\((\w+)\)s")
TAG = re.compile(r"<[^>]+>")


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    """Every text that templates, scripts and code mark, as `make messages` finds them."""
    found = tmp_path_factory.mktemp("messages") / "pbpo.pot"
    options = "--mapping pyproject.toml --keyword translatable --add-location file --output"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        command = ["pybabel", "--quiet", "extract", *options.split(), str(found), "."]
        CommandLineInterface().run(command)  # type: ignore[no-untyped-call]
    with found.open("rb") as file:
        return read_po(file)


def catalogue(language: str) -> Catalog:
    with (page_words.LOCALE / language / "LC_MESSAGES" / "pbpo.po").open("rb") as file:
        return read_po(file, locale=language)


def texts(catalogue: Catalog) -> Iterator[Message]:
    return (message for message in catalogue if message.id)


def forms(text: str | list[str] | tuple[str, ...]) -> tuple[str, ...]:
    return (text,) if isinstance(text, str) else tuple(text)


def test_japanese_is_spoken() -> None:
    assert page_words.available_locales() == ("en", "ja")


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_text_is_translated_and_no_other(said: Catalog, language: str) -> None:
    translated = {
        message.id
        for message in texts(catalogue(language))
        if not message.fuzzy and message.string and all(forms(message.string))
    }
    wanted = {message.id for message in texts(said)}
    assert len(wanted) > 150
    assert sorted(map(str, wanted - translated)) == [], "`make messages`, then translate these"
    assert sorted(map(str, translated - wanted)) == [], "`make messages` takes these away"


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_translation_has_the_places_and_the_markup_of_its_text(language: str) -> None:
    for message in texts(catalogue(language)):
        wanted = forms(message.id)[-1]
        for form in forms(message.string or ""):
            assert sorted(PLACE.findall(form)) == sorted(PLACE.findall(wanted)), wanted
            assert sorted(TAG.findall(form)) == sorted(TAG.findall(wanted)), wanted


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_text_of_a_script_travels_with_the_page(said: Catalog, language: str) -> None:
    # Read here as plain text: a call inside a template string escapes the extraction.
    calls = re.compile(r'gettext\(\s*("(?:[^"\\]|\\.)*"|[^)\s]+)')
    scripts = [path for path in (ROOT / "static/js").glob("*.js") if path.name != "i18n.js"]
    found = {call for path in scripts for call in calls.findall(path.read_text(encoding="utf-8"))}
    assert len(found) > 30
    assert {text.strip('"') for text in found} == set(translations.script_words(Wording(language)))


def test_the_words_of_scripts_are_nothing_in_english() -> None:
    assert translations.script_words(Wording()) == {}


#: Words between tags, and in attributes that are read out.
SPOKEN = re.compile(r'>([^<>]+)<|\b(?:aria-label|title|alt|placeholder)="([^"]*)"')


@pytest.mark.parametrize(
    "template",
    [*(ROOT / "templates/participant").glob("*.html"), ROOT / "templates/error.html"],
    ids=lambda path: path.stem,
)
def test_no_template_of_an_evaluators_page_has_words_that_are_not_marked(template: Path) -> None:
    source = template.read_text(encoding="utf-8")
    plain = re.sub(
        r"\{% trans.*?endtrans %\}|\{#.*?#\}|\{\{.*?\}\}|\{%.*?%\}", "", source, flags=re.S
    )
    spoken = ["".join(pair).strip() for pair in SPOKEN.findall(plain)]
    # What a macro writes into a tag is no text.
    texts = [text for text in spoken if '="' not in text]
    assert [text for text in texts if re.search(r"[A-Za-z]{2}", text)] == []


@pytest.mark.parametrize(
    ("language", "spoken"), [("ja", "ja"), ("ja-JP", "ja"), ("en-GB", "en"), ("de", "en")]
)
def test_a_language_that_the_pages_do_not_speak_gets_english(language: str, spoken: str) -> None:
    assert Wording(language).spoken == spoken


def test_numbers_are_written_as_the_language_writes_them() -> None:
    assert [translations.number(value, Wording("ja")) for value in (18.0, 0.0001, 2000)] == [
        "18",
        "0.0001",
        "2,000",
    ]


def test_what_comes_into_a_translated_text_is_escaped() -> None:
    template = environment_in(Wording("ja")).from_string(
        '{{ _("Questions? Contact %(contact)s.", contact=c) }}'
    )
    assert template.render(c="<b>") == "ご質問は&lt;b&gt;までお寄せください。"
