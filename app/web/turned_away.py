"""What somebody is shown whom a study does not let in, and what they can do."""

from __future__ import annotations

from math import ceil

from fastapi import Request
from fastapi.responses import Response

from app.services import studies
from app.services.errors import AlreadyTakenPartError, EntryLinkError, TooManyBegunError
from app.services.studio import Studio

from .problems import seconds_until
from .session_pages import about, render
from .words import translatable


def taken_part(
    request: Request, slug: str, studio: Studio, error: AlreadyTakenPartError
) -> Response:
    plan = studies.find(studio, slug).plan
    return render(
        request,
        slug,
        "participant/taken_part.html",
        translatable("You have taken part already"),
        status=409,
        **about(request, plan),
        is_over=error.is_over,
        way_back=error.way_back,
    )


def no_entry(request: Request, slug: str, studio: Studio, error: EntryLinkError) -> Response:
    plan = studies.find(studio, slug).plan
    return render(
        request,
        slug,
        "participant/no_entry.html",
        translatable("A personal link is needed"),
        status=403,
        **about(request, plan),
        is_used=error.is_used,
    )


def crowded(request: Request, slug: str, studio: Studio, error: TooManyBegunError) -> Response:
    plan = studies.find(studio, slug).plan
    seconds = seconds_until(studio, error)
    response = render(
        request,
        slug,
        "participant/crowded.html",
        translatable("Too many people at once"),
        status=429,
        **about(request, plan),
        minutes=ceil(seconds / 60),
        hours=ceil(seconds / 3600),
    )
    response.headers["Retry-After"] = str(seconds)
    return response
