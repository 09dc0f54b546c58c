"""All that is stored of one person, as files: what a person may ask for (GDPR, Article 15)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from app.services.studies.repository import StudyInfo
from app.services.studies.session_modes import ALL

from .stream import File, table_file, text_file
from .table import Request
from .tables import PERSONAL, dictionary_of


def request_of(study: StudyInfo, pseudonyms: Sequence[str]) -> Request:
    """The request for everything of these participants of a study, in every mode."""
    return Request(study, ALL, participants=tuple(pseudonyms))


def files(request: Request) -> Iterator[File]:
    """The tables with this person's rows, the data dictionary, and the texts that were shown."""
    for table in PERSONAL:
        yield table_file(table, request)
    yield table_file(dictionary_of(PERSONAL), request)
    for language, texts in request.study.texts.items():
        for name, text in texts.items():
            if name in ("consent", "welcome", "debrief", "instructions"):
                yield text_file(f"texts/{language}/{name}.md", text)
