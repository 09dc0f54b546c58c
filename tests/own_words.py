"""A study in Arabic that brings the words of the pages, for tests: each is some Arabic."""

from __future__ import annotations

import io
import re
from pathlib import Path

from babel.messages.pofile import read_po, write_po

from app.study.page_words import template

SOME_ARABIC = "نص عربي."
_KEPT = re.compile(r"%\(\w+\)s|<[^>]*>")

TEXTS = {
    "consent": "# الموافقة\n\nاقرأ هذا النص، ثم اختر: A1 أو B2!\n\n1. أولاً\n2. ثانياً",  # noqa: RUF001
    "instructions": "شاهد مقطعي الفيديو، ثم اختر الأفضل.",
    "debrief": "شكراً لك.",
}


def words(language: str = "ar") -> str:
    """The catalogue, filled: what stands in a text stays there."""
    catalogue = read_po(io.BytesIO(template(language).encode()), locale=language)
    for message in catalogue:
        if message.id:
            english = message.id if isinstance(message.id, str) else message.id[-1]
            form = " ".join([SOME_ARABIC, *_KEPT.findall(english)])
            forms = (form,) * catalogue.num_plurals
            message.string = forms if message.pluralizable else form
    sink = io.BytesIO()
    write_po(sink, catalogue, width=0)
    return sink.getvalue().decode()


def write_arabic_texts(folder: Path, *, own_words: bool) -> None:
    """Its texts, and the words of the pages if it has them."""
    texts = folder / "texts" / "ar"
    texts.mkdir(parents=True, exist_ok=True)
    for name, text in TEXTS.items():
        (texts / f"{name}.md").write_text(text, encoding="utf-8")
    if own_words:
        (texts / "words.po").write_text(words(), encoding="utf-8")
