"""Renders every page that an evaluator sees as a standalone HTML file.

Styles are inlined, scripts are removed, and still images replace the videos.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from fastapi import Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.ethics import screenshots
from app.services.ethics.page_states import screens, still_clips
from app.services.runtime.ids import receipt_code
from app.services.sessions.state_view import State, rendered
from app.services.studies.repository import StudyInfo
from app.web.http.security import session_cookie
from app.web.http.templating import STATIC
from app.web.http.wordings import wording_of

from .privacy_sentences import sentences
from .session_pages import about, render
from .stage_pages import stage_page

#: A token of no session. Pages with a receipt code show the code that belongs to it.
_EXAMPLE_TOKEN = "example"  # noqa: S105

#: A page as tall as a laptop's window, however tall the picture may be.
_OF_A_LAPTOP = f"""
body {{ min-height: {screenshots.HEIGHT}px !important; }}
.player img {{ width: 100%; height: 100%; object-fit: contain; }}
"""

_VIDEO = re.compile(r"<video\b[^>]*>\s*</video>")
_SCRIPT = re.compile(r"\s*<script\b.*?</script>", re.DOTALL)
_LINK = re.compile(r"\s*<link\b[^>]*>")


def snapshots(
    request: Request, app: AppContext, study: StudyInfo, language: str
) -> Iterator[tuple[str, str]]:
    """Name and HTML of every page in this language, numbered in the order of a session."""
    with app.recordings.files(still_clips(app, study)) as files:
        stills = screenshots.stills(files) or [None]
    pages = _pages(_as_evaluator(request, study.slug), app, study, language)
    for number, (name, page) in enumerate(pages, start=1):
        yield f"{number:02}-{name}", _standalone(page, stills)


def _pages(
    request: Request, app: AppContext, study: StudyInfo, language: str
) -> Iterator[tuple[str, Response]]:
    slug = study.slug
    example: dict[str, Any] = {"receipt": receipt_code(_EXAMPLE_TOKEN), "is_held": False}
    before: dict[str, Any] = {"languages": [], "arrival": "", **example}
    for screen in screens(app, study, language):
        if screen.name == "consent" and "welcome" in study.texts[language]:
            yield "welcome", stage_page(request, slug, _welcome(study, screen.state), **before)
        more = before if screen.name == "consent" else example
        yield screen.name, stage_page(request, slug, screen.state, **more)
        if screen.name.startswith("comparison-1"):
            title = "Stop taking part?"
            yield (
                "stop",
                render(
                    request,
                    slug,
                    "participant/withdraw.html",
                    title,
                    screen.state,
                    may_delete=True,
                ),
            )
    said = about(request, study.plan, language)
    yield (
        "privacy",
        render(
            request,
            slug,
            "participant/privacy.html",
            "Your privacy",
            **said,
            plan=study.plan,
            sentences=sentences(app, study.plan, wording_of(app, slug, said["language"])),
        ),
    )
    asked: dict[str, Any] = {"fault": None, "typed": "", "is_found": False}
    title = "Delete my answers"
    yield "delete", render(request, slug, "participant/delete.html", title, **said, **asked)


def _welcome(study: StudyInfo, consent: State) -> State:
    html = rendered(study.texts[consent["language"]]["welcome"])
    return {**consent, "stage": "welcome", "welcome": {"html": html}}


def _as_evaluator(request: Request, slug: str) -> Request:
    """A request for the study's own page, at the address where it is served."""
    cookie = f"{session_cookie(slug)}={_EXAMPLE_TOKEN}".encode()
    host = request.headers.get("host", "").encode()
    return Request(
        {
            **{key: request.scope[key] for key in ("type", "scheme", "server", "app")},
            "method": "GET",
            "path": f"/s/{slug}",
            "query_string": b"",
            "headers": [(b"host", host), (b"cookie", cookie)],
        }
    )


def _standalone(page: Response, stills: list[str | None]) -> str:
    html = bytes(page.body).decode()
    styles = f"<style>{_styles()}{_OF_A_LAPTOP}</style>"
    html = _SCRIPT.sub("", _LINK.sub("", html))
    shown = iter(stills * 2)

    def picture(_video: re.Match[str]) -> str:
        still = next(shown)
        return "" if still is None else f'<img src="{still}" alt="">'

    html = _VIDEO.sub(picture, html)
    if stills != [None]:
        # As it looks once the videos play.
        html = html.replace('data-state="loading"', 'data-state="playing"')
        html = re.sub(r'<div class="player-note">.*?</div>', "", html, flags=re.DOTALL)
        html = html.replace(' disabled aria-disabled="true"', ' aria-disabled="false"')
    # Last: what was changed above stands in the styles, too.
    return html.replace("</head>", f"  {styles}\n</head>")


@lru_cache(maxsize=1)
def _styles() -> str:
    return (STATIC / "css" / "app.css").read_text(encoding="utf-8")
