"""Translations of the application's own texts.

Templates, scripts and code contain the English texts. Every other language has a catalogue,
`locale/<language>/LC_MESSAGES/pbpo.po`, which is read directly: nothing has to be compiled.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from decimal import Decimal
from functools import cache
from gettext import NullTranslations
from pathlib import Path

from babel.messages.catalog import Catalog
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from babel.numbers import format_decimal
from babel.support import Translations

SOURCE_LANGUAGE = "en"
DOMAIN = "pbpo"
LOCALE = Path(__file__).parents[1] / "locale"

#: Sources of the texts that are sent with a page for its scripts.
SCRIPTS = "static/js/"


def translatable(text: str) -> str:
    """Mark a text that is translated later, where it is shown."""
    return text


@cache
def available_locales() -> tuple[str, ...]:
    """Languages that the pages are available in; English first."""
    return (SOURCE_LANGUAGE, *sorted(path.parts[-3] for path in LOCALE.glob("*/*/*.po")))


def negotiate_locale(language: str) -> str:
    """The available language for readers of `language`; English if there is none."""
    base = language.split("-", maxsplit=1)[0]
    return next((one for one in (language, base) if one in available_locales()), SOURCE_LANGUAGE)


@cache
def _catalogue(language: str) -> Catalog:
    with (LOCALE / language / "LC_MESSAGES" / f"{DOMAIN}.po").open("rb") as file:
        return read_po(file, locale=language, domain=DOMAIN, abort_invalid=True)


@cache
def translations(language: str) -> NullTranslations:
    """The translations of `language`, one of `available_locales()`."""
    if language == SOURCE_LANGUAGE:
        return NullTranslations()
    compiled = io.BytesIO()
    write_mo(compiled, _catalogue(language))
    compiled.seek(0)
    return Translations(compiled, domain=DOMAIN)


def translated(text: str, language: str) -> str:
    """The translation of an English text into the language of a page."""
    return translations(negotiate_locale(language)).gettext(text)


def number(value: float, language: str) -> str:
    """A number as readers of the language write it."""
    return format_decimal(value, locale=negotiate_locale(language), decimal_quantization=False)


def exact_number(value: str, language: str) -> str:
    """A number in ASCII, with the language's decimal mark and no marks for thousands."""
    return format_decimal(
        Decimal(value),
        locale=negotiate_locale(language),
        decimal_quantization=False,
        group_separator=False,
    )


def between_sentences(language: str) -> str:
    """The separator of two sentences in a paragraph: empty in Japanese."""
    return "" if language == "ja" else " "


@cache
def script_words(language: str) -> Mapping[str, str]:
    """The texts of the scripts, from English to one of `available_locales()`; empty for English."""
    if language == SOURCE_LANGUAGE:
        return {}
    return {
        str(message.id): str(message.string)
        for message in _catalogue(language)
        if any(file.startswith(SCRIPTS) for file, _ in message.locations)
    }
