"""Entry to a study: `/s/{slug}` always shows the page of the session's current stage."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.services.arrival import admission, decline_counter, re_entry
from app.services.arrival.session_holder import Holder
from app.services.context import AppContext
from app.services.runtime.errors import (
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
from app.services.runtime.ids import new_secret
from app.services.sessions import advance, withdrawal
from app.services.sessions.state_view import ENDED, State
from app.services.studies import repository, session_modes
from app.study import recruitment
from app.study.recruitment import Outcome
from app.web.http import languages, session_paths
from app.web.http.concurrency import limited_write
from app.web.http.security import AppDep, credential_of, session_cookie
from app.web.http.translations import translatable

from . import arrival_parameters, mturk_pages, refusal_pages, session_cookies
from .error_pages import EvaluatorRoute
from .session_pages import about, do, is_known, render, to_stage, token_of
from .stage_pages import TITLES, stage_page

router = APIRouter(prefix="/s/{slug}", include_in_schema=False, route_class=EvaluatorRoute)


@router.get("")
def enter(slug: str, request: Request, app: AppDep) -> Response:
    """The page of the stage that the browser's session is in; for a newcomer, the landing page."""
    outside = mturk_pages.outside_the_study(request, slug, app)
    if outside is not None:
        return outside
    holder = arrival_parameters.holder(request, slug, app)
    if holder is Holder.UNCERTAIN:
        return refusal_pages.uncertain(request, slug, app)
    if holder is not Holder.SAME:
        return _arrival(request, slug, app)
    try:
        token = token_of(request, slug)
        state = advance.current(app, token)
    except SessionExpiredError as error:
        return _gone(request, slug, app, error)
    except SignInRequiredError:
        return _arrival(request, slug, app)
    response = stage_page(request, slug, state)
    if state["stage"] == "consent":
        session_cookies.show_that_kept(request, app, response)
    if state["stage"] in ENDED:
        session_cookies.still_has_ended(request, response, app, slug, token)
    return response


@router.get("/consent")
def read_consent(slug: str, request: Request, app: AppDep) -> Response:
    """The consent, for a newcomer who has read the welcome."""
    outside = mturk_pages.outside_the_study(request, slug, app)
    if outside is not None:
        return outside
    if arrival_parameters.holder(request, slug, app) in (Holder.SAME, Holder.UNCERTAIN):
        token = token_of(request, slug)
        if is_known(app, token) or _is_barred(app, token):
            return to_stage(slug, request.url.query)
    return _arrival(request, slug, app, past_welcome=True)


@router.post("/consent")
@limited_write
def consent(
    slug: str,
    request: Request,
    app: AppDep,
    version: Annotated[str, Form()],
    arrival: Annotated[str, Form()] = "",
) -> Response:
    """Agree. Nothing is stored of a newcomer before this."""
    holder = arrival_parameters.holder(request, slug, app)
    if holder is Holder.UNCERTAIN:
        return to_stage(slug, request.url.query)
    token = request.cookies.get(session_cookie(slug)) if holder is Holder.SAME else None
    browser = session_cookies.secret_of(request)
    if token is not None:
        successor = advance.successor_of(app, token, browser)
        if is_known(app, token) or is_known(app, successor):
            response = _agree(request, slug, app, token, version, successor)
            kept = successor if is_known(app, successor) else token
            session_cookies.keep_session(response, app, slug, kept)
            return response
    entered = admission.token_of_started_session(app, slug, arrival, browser) or _enter(
        request, slug, app, version, arrival, after=token
    )
    if isinstance(entered, Response):
        return entered
    response = _agree(request, slug, app, entered, version)
    session_cookies.keep_session(response, app, slug, entered, arrival_parameters.entry(request))
    return response


def _agree(
    request: Request,
    slug: str,
    app: AppContext,
    token: str,
    version: str,
    successor: str | None = None,
) -> Response:
    agreed = partial(advance.consent, app, token, version, successor=successor)
    return do(request, slug, agreed)


def _enter(
    request: Request, slug: str, app: AppContext, version: str, arrival: str, *, after: str | None
) -> str | Response:
    """The token of a newcomer's new session, or the page that explains why there is none."""
    if _is_barred(app, after):
        return to_stage(slug)
    entry = arrival_parameters.entry(request)
    given = arrival_parameters.given(request, slug, app)
    ids = given.ids
    is_signed = arrival_parameters.require_signed(request, slug, app)
    language = _language(request, slug, app)
    try:
        landing = admission.landing_page(
            app, slug, language, entry=entry, ids=ids, mode=session_paths.mode_of(request)
        )
        if version != landing.consent["version"]:
            return to_stage(slug, request.url.query)
        if after is None:
            re_entry.require_unknown(app, slug, ids)
        without_cookies = refusal_pages.without_cookies(request, slug, app)
        if without_cookies is not None:
            return without_cookies
        token, _ = admission.start(
            app,
            slug,
            external_ids=ids,
            language=landing.language,
            mode=session_paths.mode_of(request),
            by_experimenter=session_paths.mode_of(request) == session_modes.PREVIEW,
            entry=entry,
            after=after,
            arrival=arrival,
            is_signed=is_signed,
            browser=session_cookies.secret_of(request),
            credential=credential_of(request),
        )
    except (EntryLinkError, AlreadyTakenPartError, KnownPersonError) as error:
        return refusal_pages.refused(request, slug, app, error)
    except (StudyFullError, TooManyBegunError, SessionTooOldError):
        return to_stage(slug, request.url.query)
    arrival_parameters.note_unfilled(app, slug, given)
    return token


@router.post("/decline")
@limited_write
def decline(slug: str, request: Request, app: AppDep) -> Response:
    """Decline. Of a newcomer only a count is stored."""
    # The browser may hold another person's session, which this must not decline.
    is_own = arrival_parameters.holder(request, slug, app) is Holder.SAME
    token = request.cookies.get(session_cookie(slug))
    if not is_own or token is None or not is_known(app, token):
        if session_paths.mode_of(request) == session_modes.LIVE:
            decline_counter.count(app, slug)
        return render(
            request,
            slug,
            "participant/declined.html",
            TITLES["declined"],
            **about(request, repository.find(app, slug).plan),
            way_back=_way_back_of(request, app, slug, "declined"),
        )
    return do(request, slug, lambda: withdrawal.withdraw(app, token))


@router.post("/continue")
@limited_write
def go_on(
    slug: str, request: Request, app: AppDep, leaving: Annotated[str | None, Form()] = None
) -> Response:
    """Continue to the next stage. leaving: the stage of the page; another tab may have left it."""
    return do(
        request,
        slug,
        lambda: advance.continue_session(app, token_of(request, slug), leaving=leaving),
    )


def _way_back_of(
    request: Request, app: AppContext, slug: str, outcome: Outcome
) -> dict[str, Any] | None:
    """The completion code and return link for a person of whom only the entry link is known."""
    if session_paths.mode_of(request) != session_modes.LIVE:
        return None
    ids = arrival_parameters.given(request, slug, app).ids
    return recruitment.described(repository.find(app, slug).plan.recruitment, outcome, ids)


def _arrival(
    request: Request, slug: str, app: AppContext, *, past_welcome: bool = False
) -> Response:
    """The page for a browser without a session: a newcomer, or a person known by the link's ids."""
    arrival_parameters.require_signed(request, slug, app)
    try:
        re_entry.require_unknown(app, slug, arrival_parameters.given(request, slug, app).ids)
    except (AlreadyTakenPartError, KnownPersonError) as error:
        response = refusal_pages.refused(request, slug, app, error)
        return session_cookies.show_that_kept(request, app, response)
    except SessionTooOldError as error:
        return _left(request, slug, app, error)
    return _landing_page(request, slug, app, past_welcome=past_welcome)


def _gone(request: Request, slug: str, app: AppContext, error: SessionExpiredError) -> Response:
    """The response where the browser's session can no longer be continued."""
    if isinstance(error, SessionTooOldError):
        return _left(request, slug, app, error)
    return refusal_pages.expired(request, slug, app)


def _left(request: Request, slug: str, app: AppContext, error: SessionTooOldError) -> Response:
    """The response after the resume limit, by the study's resume policy."""
    if error.policy == "restart":
        return _landing_page(request, slug, app)
    plan = repository.find(app, slug).plan
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
        session_cookies.forget(response, slug)
    return response


def _is_barred(app: AppContext, token: str | None) -> bool:
    """Whether the resume limit has passed in a study that allows no second start."""
    try:
        if token is not None:
            advance.current(app, token)
    except SessionTooOldError as error:
        return error.policy == "block"
    except (SessionExpiredError, SignInRequiredError):
        return False
    return False


def _language(request: Request, slug: str, app: AppContext) -> str:
    return languages.of_reader(request, repository.find(app, slug).plan.languages)


def _landing_page(
    request: Request, slug: str, app: AppContext, *, past_welcome: bool = False
) -> Response:
    """A newcomer's first page: the welcome if the study has one, and then the consent."""
    language = _language(request, slug, app)
    entry = arrival_parameters.entry(request)
    ids = arrival_parameters.given(request, slug, app).ids
    try:
        landing = admission.landing_page(
            app, slug, language, entry=entry, ids=ids, mode=session_paths.mode_of(request)
        )
    except EntryLinkError as error:
        return refusal_pages.no_entry(request, slug, app, error)
    except TooManyBegunError as error:
        return refusal_pages.crowded(request, slug, app, error)
    except StudyFullError:
        plan = repository.find(app, slug).plan
        return render(
            request,
            slug,
            "participant/full.html",
            translatable("No place left"),
            status=409,
            **about(request, plan),
            # People from a platform need its completion code, so they are not asked to wait.
            way_back=_way_back_of(request, app, slug, "screened_out"),
        )
    except StudyNotOpenError as error:
        return render(
            request,
            slug,
            "participant/closed.html",
            translatable("Not open"),
            status=409,
            **about(request, repository.find(app, slug).plan),
            is_draft=error.is_draft,
            is_paused=isinstance(error, StudyPausedError),
        )
    state: State = {
        "stage": "consent" if past_welcome or landing.welcome is None else "welcome",
        "progress": {
            "trial": 0,
            "trials": landing.trials,
            "query": 0,
            "queries": landing.queries,
        },
        "study": landing.study,
        "language": landing.language,
        "consent": dict(landing.consent),
        "welcome": {"html": landing.welcome or ""},
    }
    page = stage_page(
        request,
        slug,
        state,
        languages=languages.links(request, landing.languages, landing.language),
        # The form sent twice before the browser has its cookie begins one session all the same.
        arrival=new_secret(),
    )
    return session_cookies.show_that_kept(request, app, page)
