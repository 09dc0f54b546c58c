"""The language of an evaluator's page, and the words that its study has for the page."""

from __future__ import annotations

from fastapi import Request
from sqlalchemy.exc import SQLAlchemyError

from app.services.context import AppContext
from app.services.runtime.errors import NotFoundError
from app.services.studies import repository
from app.study.page_words import WORDS, available_locales, spoken_locale

from . import languages
from .translations import Wording


def wording_of(app: AppContext, slug: str, language: str) -> Wording:
    """The wording of this study's pages in a language."""
    if spoken_locale(language) is not None:
        return Wording(language)
    try:
        texts = repository.find(app, slug).texts
    except (NotFoundError, SQLAlchemyError):
        return Wording(language)
    return Wording(language, texts.get(language, {}).get(WORDS))


def readers_wording(request: Request, app: AppContext, slug: str) -> Wording:
    """The wording for a reader of whom no session is known.

    It is in a language of the study, or, where the study cannot be read, in one of the program's.
    """
    try:
        study = repository.find(app, slug)
    except (NotFoundError, SQLAlchemyError):
        return Wording(languages.of_reader(request, available_locales()))
    language = languages.of_reader(request, study.plan.languages)
    return wording_of(app, slug, language)
