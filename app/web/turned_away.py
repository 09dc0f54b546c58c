"""What somebody is shown whom a study does not let in, and what they can do."""

from __future__ import annotations

from math import ceil

from fastapi import Request
from fastapi.responses import Response

from app.services import studies
from app.services.errors import (
    AlreadyTakenPartError,
    EntryLinkError,
    KnownPersonError,
    TooManyBegunError,
)
from app.services.studio import Studio

from . import browser_cookies
from .problems import seconds_until
from .security import session_cookie
from .session_pages import about, is_known, render
from .words import translatable


def refused(
    request: Request,
    slug: str,
    studio: Studio,
    error: EntryLinkError | AlreadyTakenPartError | KnownPersonError,
) -> Response:
    """The page of the reason for which somebody is not let in."""
    if isinstance(error, EntryLinkError):
        return no_entry(request, slug, studio, error)
    if isinstance(error, AlreadyTakenPartError):
        return taken_part(request, slug, studio, error)
    return unknown_browser(request, slug, studio, error)


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
        has_session=is_known(studio, request.cookies.get(session_cookie(slug), "")),
    )


def expired(request: Request, slug: str, studio: Studio) -> Response:
    response = render(
        request,
        slug,
        "participant/expired.html",
        translatable("The session has expired"),
        **about(request, studies.find(studio, slug).plan),
    )
    return browser_cookies.forget(response, slug)


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


def unknown_browser(
    request: Request, slug: str, studio: Studio, error: KnownPersonError, *, is_wrong: bool = False
) -> Response:
    """Somebody of the link's id has begun: the ways to go on, if it was them.

    is_wrong: whether a receipt code was typed that is none.
    """
    return render(
        request,
        slug,
        "participant/unknown_browser.html",
        translatable("You have begun already"),
        status=404 if is_wrong else 409,
        **about(request, studies.find(studio, slug).plan),
        may_resume=error.may_resume,
        is_wrong=is_wrong,
    )


def uncertain(request: Request, slug: str, studio: Studio) -> Response:
    """The link names a person, and the browser has a session that began without a name."""
    return render(
        request,
        slug,
        "participant/uncertain.html",
        translatable("Is it you?"),
        status=409,
        **about(request, studies.find(studio, slug).plan),
    )


def without_cookies(request: Request, slug: str, studio: Studio) -> Response | None:
    """None if the browser keeps cookies; else its form is sent on once, and then told of it."""
    if browser_cookies.are_kept(request, slug):
        return None
    return browser_cookies.sent_on(request, studio) or render(
        request,
        slug,
        "participant/no_cookies.html",
        translatable("This browser keeps no cookies"),
        status=409,
        **about(request, studies.find(studio, slug).plan),
        way_in=browser_cookies.way_in(request, slug),
        over_http=studio.settings.secure_cookies and request.url.scheme == "http",
    )
