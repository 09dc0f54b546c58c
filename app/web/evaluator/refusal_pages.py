"""Pages for people who are not admitted to a study, with the reason and what they can do."""

from __future__ import annotations

from math import ceil

from fastapi import Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.runtime.errors import (
    AlreadyTakenPartError,
    EntryLinkError,
    KnownPersonError,
    TooManyBegunError,
)
from app.services.studies import repository
from app.web.http.problems import seconds_until
from app.web.http.security import session_cookie
from app.web.http.translations import translatable

from . import session_cookies
from .session_pages import about, is_known, render


def refused(
    request: Request,
    slug: str,
    app: AppContext,
    error: EntryLinkError | AlreadyTakenPartError | KnownPersonError,
) -> Response:
    """The page for the reason of this error."""
    if isinstance(error, EntryLinkError):
        return no_entry(request, slug, app, error)
    if isinstance(error, AlreadyTakenPartError):
        return taken_part(request, slug, app, error)
    return unknown_browser(request, slug, app, error)


def taken_part(
    request: Request, slug: str, app: AppContext, error: AlreadyTakenPartError
) -> Response:
    """The page for a person who has already taken part."""
    plan = repository.find(app, slug).plan
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


def no_entry(request: Request, slug: str, app: AppContext, error: EntryLinkError) -> Response:
    """The page for a missing, used or expired personal link."""
    plan = repository.find(app, slug).plan
    return render(
        request,
        slug,
        "participant/no_entry.html",
        translatable("A personal link is needed"),
        status=403,
        **about(request, plan),
        is_used=error.is_used,
        has_session=is_known(app, request.cookies.get(session_cookie(slug), "")),
    )


def expired(request: Request, slug: str, app: AppContext) -> Response:
    """The page for a session that was left for longer than the study allows."""
    response = render(
        request,
        slug,
        "participant/expired.html",
        translatable("The session has expired"),
        **about(request, repository.find(app, slug).plan),
    )
    return session_cookies.forget(response, slug)


def crowded(request: Request, slug: str, app: AppContext, error: TooManyBegunError) -> Response:
    """The page for a study with too many recent starts, with the time to come back."""
    plan = repository.find(app, slug).plan
    seconds = seconds_until(app, error)
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
    request: Request, slug: str, app: AppContext, error: KnownPersonError, *, is_wrong: bool = False
) -> Response:
    """The page for a link whose person has begun in another browser, with the ways to continue.

    is_wrong: whether a receipt code was typed that belongs to no session.
    """
    return render(
        request,
        slug,
        "participant/unknown_browser.html",
        translatable("You have begun already"),
        status=404 if is_wrong else 409,
        **about(request, repository.find(app, slug).plan),
        may_resume=error.may_resume,
        is_wrong=is_wrong,
    )


def uncertain(request: Request, slug: str, app: AppContext) -> Response:
    """The page for a link with ids in a browser whose session began without ids."""
    return render(
        request,
        slug,
        "participant/uncertain.html",
        translatable("Is it you?"),
        status=409,
        **about(request, repository.find(app, slug).plan),
    )


def without_cookies(request: Request, slug: str, app: AppContext) -> Response | None:
    """None if the browser keeps cookies; else one redirect of the form, then an explanation."""
    if session_cookies.are_kept(request, slug):
        return None
    return session_cookies.sent_on(request, app) or render(
        request,
        slug,
        "participant/no_cookies.html",
        translatable("This browser keeps no cookies"),
        status=409,
        **about(request, repository.find(app, slug).plan),
        way_in=session_cookies.way_in(request, slug),
        over_http=app.settings.secure_cookies and request.url.scheme == "http",
    )
