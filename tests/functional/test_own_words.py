"""A study brings the words of evaluators' pages in a language that the program does not have."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import httpx
import pytest

from app.services.context import AppContext
from app.services.studies import folder_export, repository
from app.study.page_words import direction, own_name, template, words_faults
from app.study.validation_errors import StudyFaults
from tests.conftest import SHORT_PLAN, Clock, write_study
from tests.own_words import words, write_arabic_texts

from .client import Api
from .test_languages import english_in
from .test_participant_pages import in_browser

ARABIC = (
    SHORT_PLAN.replace("languages: [en]", "languages: [ar]")
    .replace("{en: A short study}", "دراسة قصيرة")
    .replace("{en: I don't like either.}", "كلاهما سيئ")
    .replace("{en: It's hard to choose.}", "يصعب الاختيار")
)


def arabic_folder(folder: Path, *, own_words: bool) -> Path:
    write_study(folder, ARABIC)
    shutil.rmtree(folder / "texts")
    write_arabic_texts(folder, own_words=own_words)
    return folder


def opened(app: AppContext, folder: Path) -> None:
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "short")


def tag(page: httpx.Response, name: str) -> str:
    found = re.search(rf"<{name}\b[^>]*>", page.text)
    assert found is not None
    return found[0]


def test_a_study_with_words_of_its_own_has_no_english_on_any_page(
    app: AppContext, client: Api, tmp_path: Path, clock: Clock
) -> None:
    opened(app, arabic_folder(tmp_path / "study", own_words=True))
    for stage in ("consent", "instructions", "query", "break", "debrief", "completed", "withdrawn"):
        client.cookies.clear()
        in_browser(client, stage, clock)
        page = client.get("/s/short")
        assert tag(page, "html") == '<html lang="ar" dir="rtl">', stage
        assert tag(page, "body") == "<body>", stage
        assert english_in(page) == [], stage
    client.cookies.clear()
    for path in ("", "/privacy", "/delete", "/nothing-here"):
        page = client.get(f"/s/short{path}")
        assert tag(page, "html") == '<html lang="ar" dir="rtl">', path
        assert english_in(page) == [], path


def test_words_that_nobody_translated_are_marked_as_english(
    app: AppContext, client: Api, tmp_path: Path
) -> None:
    opened(app, arabic_folder(tmp_path / "study", own_words=False))
    page = client.get("/s/short")
    assert tag(page, "html") == '<html lang="ar" dir="rtl" data-untranslated>'
    assert tag(page, "body") == '<body lang="en">'
    assert '<div class="prose" lang="ar" dir="rtl">' in page.text
    assert "I agree and want to take part" in english_in(page)


def test_the_check_says_that_a_language_has_no_words_and_how_to_get_them(tmp_path: Path) -> None:
    found = repository.examine_folder(str(arabic_folder(tmp_path / "a", own_words=False)))
    assert found.study is not None
    [remark] = [str(one) for one in found.remarks]
    assert "texts/ar/words.po" in remark
    assert "stay English in العربية" in remark
    assert "pbpo study words ar" in remark
    whole = repository.examine_folder(str(arabic_folder(tmp_path / "b", own_words=True)))
    assert (whole.faults, whole.remarks, whole.unused) == ((), (), ())
    (tmp_path / "b" / "texts" / "ar" / "words.po").write_text(template("ar"), encoding="utf-8")
    [remark] = [str(one) for one in repository.examine_folder(str(tmp_path / "b")).remarks]
    assert "texts are not translated" in remark


def test_a_translation_that_would_lose_a_number_is_a_fault(tmp_path: Path) -> None:
    folder = arabic_folder(tmp_path / "study", own_words=True)
    file = folder / "texts" / "ar" / "words.po"
    broken = words().replace("نص عربي. %(number)s %(total)s", "نص عربي. %(number)s", 1)
    assert broken != words()
    file.write_text(broken, encoding="utf-8")
    with pytest.raises(StudyFaults, match=r"expected the places number, total .* got number"):
        repository.load_folder(str(folder))
    assert [fault.line for fault in words_faults("ar", broken)] != [None]
    file.write_text('msgid "Not closed\n', encoding="utf-8")
    with pytest.raises(StudyFaults, match=r"expected a \.po file"):
        repository.load_folder(str(folder))


def test_a_copy_of_the_study_has_its_words(app: AppContext, tmp_path: Path) -> None:
    folder = arabic_folder(tmp_path / "study", own_words=True)
    opened(app, folder)
    folder_export.write_folder(app, "short", tmp_path / "copy", "other")
    copied = (tmp_path / "copy" / "texts" / "ar" / "words.po").read_text(encoding="utf-8")
    assert copied == (folder / "texts" / "ar" / "words.po").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("language", "written", "name"),
    [("ar", "rtl", "العربية"), ("he", "rtl", "עברית"), ("de-AT", "ltr", "Deutsch (Österreich)")],
)
def test_a_language_has_its_direction_and_its_name(language: str, written: str, name: str) -> None:
    assert (direction(language), own_name(language)) == (written, name)
