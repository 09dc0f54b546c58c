"""Refusals as HTTP: one table from domain errors to statuses, and RFC 9457 answers."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import DataError, IntegrityError, OperationalError
from sqlalchemy.exc import TimeoutError as WaitedTooLongError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from app.services.context import AppContext
from app.services.drafts import uploads
from app.services.runtime import errors
from app.storage.commit import CommitLostError
from app.storage.integrity_errors import is_conflict
from app.study import stages
from app.study.shortening import shortened

from .refusal_size import bounded, sentence
from .templating import page
from .translations import Wording, translatable, translated
from .wordings import readers_wording

log = logging.getLogger(__name__)


MEDIA_TYPE = "application/problem+json"

#: Stable names: programs tell one refusal from another by them.
TYPE_PREFIX = "urn:pbpo-studio:problem:"


class Problem(BaseModel):
    """A refusal, as RFC 9457 has it. Some kinds say more, such as the stage a session is in."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="Stable: programs tell one kind of refusal from another by it.")
    title: str
    status: int
    detail: str = Field(description="What was expected, and what came.")


@dataclass(frozen=True)
class Kind:
    """One kind of refusal."""

    status: int
    name: str
    title: str


#: The first entry that the error is an instance of counts: the special before the general.
KINDS: tuple[tuple[type[Exception], Kind], ...] = (
    (errors.NotFoundError, Kind(404, "not-found", "Not found")),
    (errors.StudyDeletedError, Kind(410, "study-deleted", "This study was deleted")),
    (errors.GoneError, Kind(410, "gone", "Deleted")),
    (errors.TooManyTriesError, Kind(429, "too-many-tries", "Too many tries")),
    (errors.TooManyPasswordsError, Kind(429, "too-many-sign-ins", "Too many are signing in")),
    (errors.TooManyBegunError, Kind(429, "too-many-begun", "Too many are beginning")),
    (errors.TooManyError, Kind(429, "too-many", "Too many")),
    (errors.InvitationError, Kind(410, "invitation", "This link is of no use any more")),
    (errors.StoreAwayError, Kind(503, "store-away", "The videos cannot be reached")),
    (errors.SessionExpiredError, Kind(401, "session-expired", "The session has expired")),
    (errors.SignInRequiredError, Kind(401, "unauthenticated", "Not signed in")),
    (errors.EntryLinkError, Kind(403, "entry-link", "A personal link is needed")),
    (errors.SignedLinkError, Kind(403, "signed-link", "A link that the platform signed is needed")),
    (errors.ForbiddenError, Kind(403, "forbidden", "Not allowed")),
    (uploads.UploadRefusedError, Kind(422, "upload-refused", "This file cannot be taken")),
    (
        errors.UndeclaredIdentifierError,
        Kind(422, "undeclared-identifier", "This identifier is not kept"),
    ),
    (errors.LeaseLostError, Kind(409, "lease-lost", "The lease has ended")),
    (errors.OtherBytesError, Kind(409, "other-bytes", "Recorded already")),
    (errors.UploadOffsetError, Kind(409, "upload-offset", "Bytes are missing before these")),
    (
        errors.RecordingRefusedError,
        Kind(422, "recording-refused", "This recording cannot be taken"),
    ),
    (errors.StudyPausedError, Kind(409, "study-paused", "The study is paused")),
    (errors.StudyNotOpenError, Kind(409, "study-not-open", "The study is not open")),
    (errors.SkipReasonError, Kind(422, "skip-reason", "No reason for this")),
    (errors.TooLateToUndoError, Kind(409, "too-late-to-undo", "Too late to undo")),
    (errors.SetAsideError, Kind(409, "set-aside", "Another query took its place")),
    (errors.NotRecordedYetError, Kind(409, "not-recorded-yet", "Not recorded yet")),
    (errors.NothingToShowError, Kind(409, "nothing-to-show", "No video can be shown")),
    (errors.IdsRefusedError, Kind(422, "ids-refused", "This link cannot be read")),
    (errors.KnownPersonError, Kind(409, "known-person", "Begun already")),
    (errors.AlreadyTakenPartError, Kind(409, "already-taken-part", "Taken part already")),
    (errors.AlreadyAnsweredError, Kind(409, "already-answered", "Already answered")),
    (errors.SkipNotOfferedError, Kind(409, "skip-not-offered", "No skip here")),
    (errors.AnswersRefusedError, Kind(422, "answers-refused", "Some answers cannot be taken")),
    (errors.StudyFullError, Kind(409, "study-full", "The study is full")),
    (errors.ConflictError, Kind(409, "conflict", "Not possible now")),
    (stages.StaleConsent, Kind(409, "stale-consent", "The consent text has changed")),
    (stages.BreakNotOver, Kind(409, "break-not-over", "The break is not over")),
    (stages.DeviceRefused, Kind(409, "device-refused", "The device did not pass its check")),
    (stages.WatchMore, Kind(409, "watch-more", "Some videos are still to be watched")),
    (stages.ProtocolError, Kind(409, "out-of-order", "Out of order")),
)


#: Shown to evaluators in place of details meant for programmers.
_NOTHING_HERE = translatable(
    "There is nothing at this address. Please open the link just as it was sent to you."
)
_NOT_NOW = translatable(
    "Please open the study's link again: it leads to where you were."
    " If that does not help, tell the people who sent it to you."
)
#: Advice by the name of the refusal.
_ADVICE = {
    "signed-link": translatable(
        "This study is open to people whom Prolific sends. Please open it again from your page at"
        " Prolific. If that does not help, tell the people who run the study."
    ),
    "ids-refused": translatable(
        "This link does not say clearly who you are: a part of it came twice, or is too long."
        " Please open the study again from where you found it."
        " If that does not help, tell the people who run the study."
    ),
}
_EVALUATORS_TITLES = {404: translatable("Not found"), 422: translatable("Not understood")}
_OTHER_TITLE = translatable("That is not possible now")


def kind_of(error: Exception) -> Kind:
    """The status, name and title of a domain error."""
    return next(kind for domain_error, kind in KINDS if isinstance(error, domain_error))


def problem(kind: Kind, detail: str, **extra: Any) -> JSONResponse:
    """The RFC 9457 response for this kind of error. extra: further members of the body."""
    body = {
        "type": f"{TYPE_PREFIX}{kind.name}",
        "title": shortened(kind.title),
        "status": kind.status,
        "detail": _short(detail),
        **bounded(extra),
    }
    headers = {"WWW-Authenticate": "Bearer"} if kind.status == 401 else None
    return JSONResponse(body, kind.status, headers, media_type=MEDIA_TYPE)


#: What refusals of each status mean; their `type` says more.
_MEANINGS = {
    400: "The body could not be read.",
    401: "No token, or none that is good any more.",
    403: "Not allowed.",
    404: "Not found.",
    409: "Not possible as things stand.",
    410: "Deleted.",
    413: "The body is too long.",
    422: "Not understood.",
    429: "Too many at once: `Retry-After` says when to come back.",
    503: "The database could not be used. Nothing was changed, or, where `type` ends in"
    " `outcome-unknown`, all or nothing: look, and send the same again.",
}
#: What any call may come to, and any that takes a body besides.
_ALWAYS, _WITH_BODY = (422, 503), (400, 403, 413)


def _short(detail: str) -> str:
    """The detail as it can be sent: short, and without half of a surrogate pair."""
    return shortened(detail).encode("utf-8", "replace").decode()


def refusals(*statuses: int, body: bool = False) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI descriptions of problem responses with these statuses.

    body: whether the route takes a body.
    """
    content = {MEDIA_TYPE: {"schema": Problem.model_json_schema()}}
    all_statuses = sorted({*statuses, *_ALWAYS, *(_WITH_BODY if body else ())})
    return {
        status: {"description": _MEANINGS[status], "content": content} for status in all_statuses
    }


def install(fastapi_app: FastAPI) -> None:
    """Answer every refusal of `app` as a problem, or as a page where a page was asked for."""
    for refusal, _ in KINDS:
        fastapi_app.add_exception_handler(refusal, domain_error)
    fastapi_app.add_exception_handler(RequestValidationError, _invalid)
    fastapi_app.add_exception_handler(DataError, _not_storable)
    fastapi_app.add_exception_handler(IntegrityError, _clash)
    for failure in (OperationalError, WaitedTooLongError):
        fastapi_app.add_exception_handler(failure, _out_of_order)
    fastapi_app.add_exception_handler(CommitLostError, _outcome_unknown)
    fastapi_app.add_exception_handler(HTTPException, _http_error)


def _is_api(request: Request) -> bool:
    return request.url.path.startswith(("/api/", "/media/"))


async def _answer(request: Request, kind: Kind, detail: str, **extra: Any) -> Response:
    if _is_api(request):
        return problem(kind, detail, **extra)
    title, wording = kind.title, Wording()
    if request.url.path.startswith(("/s/", "/pilot/s/")):
        slug = request.url.path.removeprefix("/pilot").split("/")[2]
        wording = await run_in_threadpool(readers_wording, request, request.app.state.app, slug)
        title = translated(_EVALUATORS_TITLES.get(kind.status, _OTHER_TITLE), wording)
        advice = _NOTHING_HERE if kind.status == 404 else _ADVICE.get(kind.name, _NOT_NOW)
        detail = translated(advice, wording)
    return page(
        request,
        "error.html",
        {
            "status": kind.status,
            "title": title,
            "detail": _short(detail),
            "page_title": title,
            "language": wording.language,
            "wording": wording,
        },
        status_code=kind.status,
    )


async def domain_error(request: Request, error: Exception) -> Response:
    """The response to a domain error, with the members that its type adds."""
    extra: dict[str, Any] = {}
    # Calls that are out of order receive the stage of the session.
    if isinstance(error, stages.OutOfOrder | errors.ResponseRefusedError):
        extra["stage"] = str(error.stage)
    if isinstance(error, errors.StudyDeletedError):
        extra["way_back"] = error.way_back
    if isinstance(error, errors.AnswersRefusedError):
        extra["stage"] = error.stage
        extra["faults"] = [asdict(fault) for fault in error.faults]
    if isinstance(error, stages.BreakNotOver):
        extra["stage"] = str(stages.Stage.BREAK)
        extra["seconds_left"] = error.seconds_left
    if isinstance(error, stages.DeviceRefused):
        extra["stage"] = str(stages.Stage.DEVICE_CHECK)
        extra["lacks"] = list(error.lacks)
    if isinstance(error, stages.WatchMore):
        extra["stage"] = str(stages.Stage.FAMILIARISATION)
        extra["videos_left"] = error.left
    if isinstance(error, stages.StaleConsent):
        extra["stage"] = str(stages.Stage.CONSENT)
        extra["current_version"] = error.current
    if isinstance(error, errors.UploadOffsetError):
        extra["received"] = error.received
    response = await _answer(request, kind_of(error), str(error), **extra)
    if isinstance(error, errors.TooManyError):
        response.headers["Retry-After"] = str(seconds_until(request.app.state.app, error))
    return response


def seconds_until(app: AppContext, error: errors.TooManyError) -> int:
    """Seconds to wait before the next attempt, at least 1."""
    return max(1, ceil((error.until - app.now()).total_seconds()))


async def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    faults = [
        {
            "pointer": "/".join(str(part) for part in fault["loc"]),
            "detail": fault["msg"],
        }
        for fault in error.errors()
    ]
    short = (bounded(fault) for fault in faults)
    detail = sentence(f"{fault['pointer']}: {fault['detail']}" for fault in short)
    return await _answer(request, Kind(422, "invalid", "Not understood"), detail, errors=faults)


async def _not_storable(request: Request, _error: Exception) -> Response:
    detail = "expected text and numbers that the database can hold, got a NUL or a number too large"
    return await _answer(request, Kind(422, "invalid", "Not understood"), detail)


async def _clash(request: Request, error: Exception) -> Response:
    """409 for two requests that did the same at once: nothing of the second one was stored."""
    if not is_conflict(error):
        raise error
    assert isinstance(error, IntegrityError)
    log.warning("two did the same at once: %s", error.orig)
    detail = "somebody else has just done the same, or deleted what this is about: look again"
    return await _answer(request, kind_of(errors.ConflictError()), detail)


async def _out_of_order(request: Request, error: Exception) -> Response:
    """503 for a database that is full, locked or unreachable: nothing was stored."""
    log.error("the database failed", exc_info=error)
    kind = Kind(503, "unavailable", "Not possible just now")
    return await _answer(request, kind, "the database could not be used; nothing was changed")


async def _outcome_unknown(request: Request, error: Exception) -> Response:
    """503 for a connection lost during a commit: all of the request is stored, or nothing."""
    log.error("the database was lost at a commit", exc_info=error)
    kind = Kind(503, "outcome-unknown", "Perhaps done")
    detail = "the database was lost while it stored this: look whether it did, or send it again"
    return await _answer(request, kind, detail)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    names = {400: "unreadable", 404: "not-found", 405: "method-not-allowed", 413: "too-long"}
    titles = {400: "Not readable", 404: "Not found", 405: "Not that way", 413: "Too long"}
    title = titles.get(error.status_code, str(error.detail))
    kind = Kind(error.status_code, names.get(error.status_code, "http"), title)
    response = await _answer(request, kind, f"{error.detail}: {request.method} {request.url.path}")
    for name, value in (error.headers or {}).items():
        response.headers[name] = value
    return response
