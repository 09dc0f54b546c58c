"""The pages that an evaluator goes through: `/s/{slug}`, always the page of the stage one is in."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.services import (
    admission,
    declining,
    modes,
    participation,
    recruitment,
    returning,
    studies,
    withdrawal,
)
from app.services.errors import (
    AlreadyTakenPartError,
    EntryLinkError,
    KnownPersonError,
    SessionExpiredError,
    SessionTooOldError,
    SignInRequiredError,
    StudyFullError,
    StudyNotOpenError,
    StudyPausedError,
    TooManyBegunError,
)
from app.services.holding import Holder
from app.services.state import ENDED, State
from app.services.studio import Studio
from app.services.tokens import new_secret
from app.study.recruitment import Outcome

from . import arrivals, browser_cookies, entrances, languages, mturk_pages, turned_away
from .failing_kindly import FailingKindly
from .in_line import in_line
from .security import StudioDep, session_cookie
from .session_pages import about, do, is_known, render, to_stage, token_of
from .stage_pages import TITLES, stage_page
from .words import translatable

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=FailingKindly)


@router.get("")
def enter(slug: str, request: Request, studio: StudioDep) -> Response:
    """The page of the stage that the browser's session is in; for a newcomer, the consent."""
    outside = mturk_pages.outside_the_study(request, slug, studio)
    if outside is not None:
        return outside
    holder = arrivals.holder(request, slug, studio)
    if holder is Holder.UNCERTAIN:
        return turned_away.uncertain(request, slug, studio)
    if holder is not Holder.SAME:
        return _arrival(request, slug, studio)
    try:
        token = token_of(request, slug)
        state = participation.current(studio, token)
    except SessionExpiredError as error:
        return _gone(request, slug, studio, error)
    except SignInRequiredError:
        return _arrival(request, slug, studio)
    response = stage_page(request, slug, state)
    if state["stage"] == "consent":
        browser_cookies.show_that_kept(request, studio, response)
    if state["stage"] in ENDED:
        browser_cookies.still_has_ended(request, response, studio, slug, token)
    return response


@router.get("/consent")
def read_consent(slug: str, request: Request, studio: StudioDep) -> Response:
    """The consent, for a newcomer who has read the welcome."""
    outside = mturk_pages.outside_the_study(request, slug, studio)
    if outside is not None:
        return outside
    if arrivals.holder(request, slug, studio) in (Holder.SAME, Holder.UNCERTAIN):
        token = token_of(request, slug)
        if is_known(studio, token) or _is_barred(studio, token):
            return to_stage(slug, request.url.query)
    return _arrival(request, slug, studio, past_welcome=True)


@router.post("/consent")
@in_line
def consent(
    slug: str,
    request: Request,
    studio: StudioDep,
    version: Annotated[str, Form()],
    arrival: Annotated[str, Form()] = "",
) -> Response:
    """Agree. Only now is anything kept of a newcomer."""
    holder = arrivals.holder(request, slug, studio)
    if holder is Holder.UNCERTAIN:
        return to_stage(slug, request.url.query)
    token = request.cookies.get(session_cookie(slug)) if holder is Holder.SAME else None
    browser = browser_cookies.secret_of(request)
    if token is not None:
        successor = participation.successor_of(studio, token, browser)
        if is_known(studio, token) or is_known(studio, successor):
            response = _agree(request, slug, studio, token, version, successor)
            kept = successor if is_known(studio, successor) else token
            browser_cookies.keep_session(response, studio, slug, kept)
            return response
    entered = admission.begun(studio, slug, arrival, browser) or _enter(
        request, slug, studio, version, arrival, after=token
    )
    if isinstance(entered, Response):
        return entered
    response = _agree(request, slug, studio, entered, version)
    browser_cookies.keep_session(response, studio, slug, entered, arrivals.entry(request))
    return response


def _agree(
    request: Request,
    slug: str,
    studio: Studio,
    token: str,
    version: str,
    successor: str | None = None,
) -> Response:
    agreed = partial(participation.consent, studio, token, version, successor=successor)
    return do(request, slug, agreed)


def _enter(
    request: Request, slug: str, studio: Studio, version: str, arrival: str, *, after: str | None
) -> str | Response:
    """The token of a newcomer's new session, or the page that says why there is none."""
    if _is_barred(studio, after):
        return to_stage(slug)
    entry = arrivals.entry(request)
    given = arrivals.given(request, slug, studio)
    ids = given.ids
    is_signed = arrivals.require_signed(request, slug, studio)
    language = _language(request, slug, studio)
    try:
        entrance = admission.entrance(
            studio, slug, language, entry=entry, ids=ids, mode=entrances.mode_of(request)
        )
        if version != entrance.consent["version"]:
            return to_stage(slug, request.url.query)
        if after is None:
            returning.require_unknown(studio, slug, ids)
        without_cookies = turned_away.without_cookies(request, slug, studio)
        if without_cookies is not None:
            return without_cookies
        token, _ = admission.start(
            studio,
            slug,
            external_ids=ids,
            language=entrance.language,
            mode=entrances.mode_of(request),
            by_experimenter=entrances.mode_of(request) == modes.PREVIEW,
            entry=entry,
            after=after,
            arrival=arrival,
            is_signed=is_signed,
            browser=browser_cookies.secret_of(request),
        )
    except (EntryLinkError, AlreadyTakenPartError, KnownPersonError) as error:
        return turned_away.refused(request, slug, studio, error)
    except (StudyFullError, TooManyBegunError, SessionTooOldError):
        return to_stage(slug, request.url.query)
    arrivals.note_unfilled(studio, slug, given)
    return token


@router.post("/decline")
@in_line
def decline(slug: str, request: Request, studio: StudioDep) -> Response:
    """Decline. Of a newcomer nothing is kept but that one more declined."""
    # The browser may hold the session of somebody else, who declines nothing by this.
    is_own = arrivals.holder(request, slug, studio) is Holder.SAME
    token = request.cookies.get(session_cookie(slug))
    if not is_own or token is None or not is_known(studio, token):
        if entrances.mode_of(request) == modes.LIVE:
            declining.count(studio, slug)
        return render(
            request,
            slug,
            "participant/declined.html",
            TITLES["declined"],
            **about(request, studies.find(studio, slug).plan),
            way_back=_way_back_of(request, studio, slug, "declined"),
        )
    return do(request, slug, lambda: withdrawal.withdraw(studio, token))


@router.post("/continue")
@in_line
def go_on(
    slug: str, request: Request, studio: StudioDep, leaving: Annotated[str | None, Form()] = None
) -> Response:
    """leaving: the stage that the page is of; another tab may have left it."""
    return do(
        request, slug, lambda: participation.go_on(studio, token_of(request, slug), leaving=leaving)
    )


def _way_back_of(
    request: Request, studio: Studio, slug: str, outcome: Outcome
) -> dict[str, Any] | None:
    """The code and the way back of somebody of whom nothing is kept but the link they came by."""
    if entrances.mode_of(request) != modes.LIVE:
        return None
    ids = arrivals.given(request, slug, studio).ids
    return recruitment.described(studies.find(studio, slug).plan, outcome, ids)


def _arrival(
    request: Request, slug: str, studio: Studio, *, past_welcome: bool = False
) -> Response:
    """Somebody without a session in this browser: a newcomer, or known by what the link says."""
    arrivals.require_signed(request, slug, studio)
    try:
        returning.require_unknown(studio, slug, arrivals.given(request, slug, studio).ids)
    except (AlreadyTakenPartError, KnownPersonError) as error:
        response = turned_away.refused(request, slug, studio, error)
        return browser_cookies.show_that_kept(request, studio, response)
    except SessionTooOldError as error:
        return _left(request, slug, studio, error)
    return _entrance(request, slug, studio, past_welcome=past_welcome)


def _gone(request: Request, slug: str, studio: Studio, error: SessionExpiredError) -> Response:
    """The browser's session can no longer be gone on with."""
    if isinstance(error, SessionTooOldError):
        return _left(request, slug, studio, error)
    return turned_away.expired(request, slug, studio)


def _left(request: Request, slug: str, studio: Studio, error: SessionTooOldError) -> Response:
    """Back after too long: what the study's resume policy has for them."""
    if error.policy == "restart":
        return _entrance(request, slug, studio)
    plan = studies.find(studio, slug).plan
    response = render(
        request,
        slug,
        "participant/left.html",
        translatable("This session cannot be taken up again"),
        status=409,
        **about(request, plan),
        may_begin_again=error.policy == "resume" and not plan.recruitment.takes_each_once,
    )
    if error.policy == "resume":
        browser_cookies.forget(response, slug)
    return response


def _is_barred(studio: Studio, token: str | None) -> bool:
    """Whether the browser's session was left for so long that the study lets nobody begin anew."""
    try:
        if token is not None:
            participation.current(studio, token)
    except SessionTooOldError as error:
        return error.policy == "block"
    except (SessionExpiredError, SignInRequiredError):
        return False
    return False


def _language(request: Request, slug: str, studio: Studio) -> str:
    return languages.of_reader(request, studies.find(studio, slug).plan.languages)


def _entrance(
    request: Request, slug: str, studio: Studio, *, past_welcome: bool = False
) -> Response:
    """A newcomer's first page: the welcome if the study has one, and then the consent."""
    language = _language(request, slug, studio)
    entry = arrivals.entry(request)
    ids = arrivals.given(request, slug, studio).ids
    try:
        entrance = admission.entrance(
            studio, slug, language, entry=entry, ids=ids, mode=entrances.mode_of(request)
        )
    except EntryLinkError as error:
        return turned_away.no_entry(request, slug, studio, error)
    except TooManyBegunError as error:
        return turned_away.crowded(request, slug, studio, error)
    except StudyFullError:
        plan = studies.find(studio, slug).plan
        return render(
            request,
            slug,
            "participant/full.html",
            translatable("No place left"),
            status=409,
            **about(request, plan),
            # Who came from a platform is owed its code: there is nothing for them to wait for.
            way_back=_way_back_of(request, studio, slug, "screened_out"),
        )
    except StudyNotOpenError as error:
        return render(
            request,
            slug,
            "participant/closed.html",
            translatable("Not open"),
            status=409,
            **about(request, studies.find(studio, slug).plan),
            is_draft=error.is_draft,
            is_paused=isinstance(error, StudyPausedError),
        )
    state: State = {
        "stage": "consent" if past_welcome or entrance.welcome is None else "welcome",
        "progress": {
            "trial": 0,
            "trials": entrance.trials,
            "query": 0,
            "queries": entrance.queries,
        },
        "study": entrance.study,
        "language": entrance.language,
        "consent": dict(entrance.consent),
        "welcome": {"html": entrance.welcome or ""},
    }
    page = stage_page(
        request,
        slug,
        state,
        languages=languages.links(request, entrance.languages, entrance.language),
        # The form sent twice before the browser has its cookie begins one session all the same.
        arrival=new_secret(),
    )
    return browser_cookies.show_that_kept(request, studio, page)
