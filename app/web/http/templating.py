"""Renders pages from the Jinja2 templates."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from . import translations
from .security import app_context_of
from .translations import Wording

ROOT = Path(__file__).resolve().parents[3]
STATIC = ROOT / "static"

#: Default values of the context of every page.
DEFAULTS: Mapping[str, Any] = {"study_title": None, "language": "en", "page_title": "PBPO Studio"}


def local_time(moment: datetime | None) -> Markup:
    """A time in UTC as a `<time>` element, which scripts show in the reader's own zone."""
    if moment is None:
        return Markup("–")
    moment = moment.astimezone(UTC)
    return Markup('<time datetime="{}">{} UTC</time>').format(
        moment.isoformat(timespec="seconds").replace("+00:00", "Z"), f"{moment:%Y-%m-%d %H:%M}"
    )


@lru_cache(maxsize=256)
def _fingerprint(path: str, _modified: float) -> str:
    return hashlib.sha256((STATIC / path).read_bytes()).hexdigest()[:12]


def static_url(path: str) -> str:
    """Address of a static file with a hash of its content, so that browsers can always cache it."""
    return f"/static/{path}?v={_fingerprint(path, (STATIC / path).stat().st_mtime)}"


def _own_language(wording: Wording) -> Markup:
    """Attributes of an element with the study's own words, where the program's are others."""
    if wording.is_translated:
        return Markup("")
    return Markup(' lang="{}" dir="{}"').format(wording.language, wording.direction)


def _own_words(attributes: Markup, text: str) -> Markup:
    """The study's own words within a sentence of the program's."""
    return Markup("<bdi{}>{}</bdi>").format(attributes, text)


@lru_cache(maxsize=64)
def environment_in(wording: Wording, root: str = "") -> Environment:
    """The Jinja2 environment of a wording.

    root: the path below which the studio is served, which templates put before every address.
    """
    made = Environment(
        loader=FileSystemLoader(ROOT / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.i18n"],
    )
    made.policies["ext.i18n.trimmed"] = True
    # The extension adds this to the environment: the type does not know of it.
    install: Callable[..., None] = vars(made)["install_gettext_translations"]
    install(translations.translations(wording), newstyle=True)
    made.filters["localtime"] = local_time
    made.filters["number"] = partial(translations.number, wording=wording)
    made.filters["exact_number"] = partial(translations.exact_number, wording=wording)
    made.globals["root"] = root
    made.globals["static_url"] = lambda path: root + static_url(path)
    made.globals["between_sentences"] = translations.between_sentences(wording)
    made.globals["script_words"] = translations.script_words(wording)
    made.globals["wording"] = wording
    made.globals["own_language"] = _own_language(wording)
    made.globals["own_words"] = partial(_own_words, _own_language(wording))
    return made


environment = environment_in(Wording())


def page(
    request: Request, template: str, context: Mapping[str, Any], status_code: int = 200
) -> HTMLResponse:
    """The page of `template` in the context's `language`, by the `wording` of the context.

    Pages show the data of a session, so they are never cached.
    """
    values = {**DEFAULTS, "path": request.url.path, **context}
    wording = values.pop("wording", None) or Wording(values["language"])
    templates = environment_in(wording, app_context_of(request).settings.root_path)
    html = templates.get_template(template).render(values)
    return HTMLResponse(html, status_code, headers={"Cache-Control": "no-store"})
