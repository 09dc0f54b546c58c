"""Translations of the application's own texts.

Templates, scripts and code contain the English texts. A catalogue translates them: one that comes
with the program, or the study's own. It is read directly: nothing has to be compiled.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from gettext import NullTranslations

from babel.messages.catalog import Catalog
from babel.messages.mofile import write_mo
from babel.numbers import format_decimal
from babel.support import Translations

from app.study import page_words
from app.study.page_words import SOURCE_LANGUAGE

#: Sources of the texts that are sent with a page for its scripts.
SCRIPTS = "static/js/"

#: Wordings that are held in memory: one for each language of the studies that are under way.
_MOST_WORDINGS = 64


@dataclass(frozen=True)
class Wording:
    """The language of a page's texts, and where its words come from.

    language: of the study's own texts. own_words: the text of the study's catalogue, if it has one.
    """

    language: str = SOURCE_LANGUAGE
    own_words: str | None = None

    @property
    def spoken(self) -> str:
        """The language of the program's words: English where nothing translates them."""
        if self.own_words is not None:
            return self.language
        return page_words.spoken_locale(self.language) or SOURCE_LANGUAGE

    @property
    def is_translated(self) -> bool:
        """Whether the program's words are in the language of the study's texts."""
        return self.own_words is not None or page_words.spoken_locale(self.language) is not None

    @property
    def direction(self) -> str:
        """In which direction the page is laid out: `ltr` or `rtl`."""
        return page_words.direction(self.language)


def translatable(text: str) -> str:
    """Mark a text that is translated later, where it is shown."""
    return text


@lru_cache(maxsize=_MOST_WORDINGS)
def _catalogue(wording: Wording) -> Catalog | None:
    if wording.own_words is not None:
        return page_words.parsed(wording.own_words, wording.language)
    return None if wording.spoken == SOURCE_LANGUAGE else page_words.catalogue(wording.spoken)


@lru_cache(maxsize=_MOST_WORDINGS)
def translations(wording: Wording) -> NullTranslations:
    """The translations of the program's words."""
    words = _catalogue(wording)
    if words is None:
        return NullTranslations()
    compiled = io.BytesIO()
    write_mo(compiled, words)
    compiled.seek(0)
    return Translations(compiled, domain=page_words.DOMAIN)


def translated(text: str, wording: Wording) -> str:
    """The translation of an English text into the words of a page."""
    return translations(wording).gettext(text)


def number(value: float, wording: Wording) -> str:
    """A number as readers of the language write it."""
    locale = page_words.babel_locale(wording.spoken)
    return format_decimal(value, locale=locale, decimal_quantization=False)


def exact_number(value: str, wording: Wording) -> str:
    """A number in ASCII, with the language's decimal mark and no marks for thousands."""
    locale = page_words.babel_locale(wording.spoken)
    return format_decimal(
        Decimal(value), locale=locale, decimal_quantization=False, group_separator=False
    )


def between_sentences(wording: Wording) -> str:
    """The separator of two sentences in a paragraph: empty in Japanese and Chinese."""
    return "" if wording.spoken.split("-")[0] in ("ja", "zh") else " "


@lru_cache(maxsize=_MOST_WORDINGS)
def script_words(wording: Wording) -> Mapping[str, str]:
    """The texts of the scripts, from English to the page's words; empty for English."""
    words = _catalogue(wording)
    if words is None:
        return {}
    # A study's catalogue may have lost where a text stands: the program's own knows.
    known = page_words.catalogue(page_words.available_locales()[1])
    of_scripts = {
        str(message.id)
        for message in known
        if any(file.startswith(SCRIPTS) for file, _ in message.locations)
    }
    return {
        str(message.id): str(message.string)
        for message in words
        if message.string and not message.fuzzy and str(message.id) in of_scripts
    }
