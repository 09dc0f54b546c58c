"""Words of evaluators' own pages in a study's language: gettext catalogues.

The pages' words are English in the code. Translations that come with the program are in
`app/web/locale`; a study can bring those of another language, as `texts/<language>/words.po`.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from babel import Locale, UnknownLocaleError
from babel.messages.catalog import Catalog, Message
from babel.messages.pofile import PoFileError, read_po, write_po

from .validation_errors import Fault

SOURCE_LANGUAGE = "en"
DOMAIN = "pbpo"
LOCALE = Path(__file__).parents[1] / "web" / "locale"
#: The name of the catalogue among a study's texts.
WORDS = "words"

_PLACE = re.compile(r"%\((\w+)\)s")
_TAG = re.compile(r"<[^>]*>")
#: No plural rules, dates or tools: what a template says of itself.
_HEADER = """\
# The words of evaluators' pages. Translate each msgid in the msgstr below it; a place such as
# %(number)s stays as it is. What is left empty stays English."""


@cache
def available_locales() -> tuple[str, ...]:
    """Languages that the pages are available in by themselves; English first."""
    return (SOURCE_LANGUAGE, *sorted(path.parts[-3] for path in LOCALE.glob("*/*/*.po")))


def spoken_locale(language: str) -> str | None:
    """The available language for readers of `language`; None if there is none."""
    base = language.split("-", maxsplit=1)[0]
    return next((one for one in (language, base) if one in available_locales()), None)


@cache
def catalogue(language: str) -> Catalog:
    """The catalogue of one of `available_locales()` but English."""
    with (LOCALE / language / "LC_MESSAGES" / f"{DOMAIN}.po").open("rb") as file:
        return read_po(file, locale=language, domain=DOMAIN, abort_invalid=True)


def babel_locale(language: str) -> Locale:
    """The nearest locale that is known; English where none is."""
    parts = language.replace("_", "-").split("-")
    for length in range(len(parts), 0, -1):
        try:
            return Locale.parse("-".join(parts[:length]), sep="-")
        except (UnknownLocaleError, ValueError):
            continue
    return Locale(SOURCE_LANGUAGE)


def own_name(language: str) -> str:
    """The language's name in that language, for readers who know no other; else its code."""
    locale = babel_locale(language)
    if locale.language != language.split("-", maxsplit=1)[0]:
        return language
    name = locale.get_display_name(locale) or language
    return name[:1].upper() + name[1:]


def direction(language: str) -> str:
    """`rtl` for a language that is written from right to left, else `ltr`."""
    return babel_locale(language).text_direction


def parsed(text: str, language: str) -> Catalog:
    """The catalogue in the text of a .po file. Raises PoFileError, ValueError."""
    return read_po(
        io.BytesIO(text.encode()), locale=str(babel_locale(language)), abort_invalid=True
    )


def template(language: str) -> str:
    """A .po file of all words of the pages, to be translated into `language`."""
    locale = babel_locale(language)
    known = available_locales()[1]
    made = Catalog(locale=locale, header_comment=_HEADER, fuzzy=False, charset="utf-8")
    for message in _messages(catalogue(known)):
        made.add(message.id, locations=message.locations, auto_comments=message.auto_comments)
    sink = io.BytesIO()
    write_po(sink, made, width=0, include_previous=False)
    return "".join(
        line
        for line in sink.getvalue().decode().splitlines(keepends=True)
        if not line.startswith(('"POT-Creation', '"PO-Revision', '"Last-Tr', '"Generated-By'))
    )


def words_faults(language: str, text: str) -> Iterator[Fault]:
    """What keeps the catalogue from being used: its form, places and tags in its translations."""
    file = f"texts/{language}/{WORDS}.po"
    try:
        given = parsed(text, language)
    except (PoFileError, ValueError) as error:
        yield Fault(file, getattr(error, "lineno", None), f"expected a .po file, got: {error}")
        return
    for message in _messages(given):
        wanted = _forms(message.id)[-1]
        for form in filter(None, _forms(message.string or "")):
            for kind, pattern in (("places", _PLACE), ("tags", _TAG)):
                expected, got = sorted(pattern.findall(wanted)), sorted(pattern.findall(form))
                # One form of a plural may do without the number ("one answer").
                if got != expected and not (message.pluralizable and set(got) <= set(expected)):
                    said = f"expected the {kind} {', '.join(expected) or 'none'} in the translation"
                    came = ", ".join(got) or "none"
                    yield Fault(file, message.lineno, f"{said} of {wanted!r}, got {came}")


def words_remarks(language: str, text: str | None) -> Iterator[Fault]:
    """What is worth knowing of the words of the pages in this language."""
    file = f"texts/{language}/{WORDS}.po"
    if spoken_locale(language) is not None:
        if text is not None:
            said = f"is not used: the pages have words in {own_name(language)} of their own"
            yield Fault(file, None, said)
        return
    wanted = {_key(message) for message in _messages(catalogue(available_locales()[1]))}
    if text is None:
        yield Fault(
            file,
            None,
            f"there is none: buttons and headings of the pages stay English in"
            f" {own_name(language)} ({len(wanted)} texts; pbpo study words {language} writes a"
            " template)",
        )
        return
    given = {
        _key(message)
        for message in _messages(parsed(text, language))
        if not message.fuzzy and any(_forms(message.string or ""))
    }
    if missing := len(wanted - given):
        yield Fault(file, None, f"{missing} of {len(wanted)} texts are not translated: English")


def _messages(words: Catalog) -> Iterator[Message]:
    return (message for message in words if message.id)


def _forms(text: str | list[str] | tuple[str, ...]) -> tuple[str, ...]:
    return (text,) if isinstance(text, str) else tuple(text)


def _key(message: Message) -> str:
    return _forms(message.id)[0]
