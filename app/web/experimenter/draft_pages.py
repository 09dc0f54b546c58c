"""Creating a study in the browser: its start, its faults, its files and texts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response
from markupsafe import Markup

from app.services import jobs
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.drafts import drafts, transcode_job
from app.services.drafts.drafts import Draft
from app.services.drafts.steps import steps
from app.services.drafts.uploads import UploadRefusedError
from app.services.maintenance import expired_drafts
from app.services.runtime import disk_quota
from app.services.runtime.errors import (
    ChangedMeanwhileError,
    ConflictError,
    ForbiddenError,
    NoRoomError,
    NotFoundError,
)
from app.services.studies import access
from app.study.markdown import render
from app.study.text_diff import difference, text_hash
from app.study.validation_errors import StudyFaults, grouped, in_lines
from app.web.http.security import AppDep

from .page_context import OwnForm, SignedIn, experimenter_page
from .upload_forms import MOST_FILES, drain, sent_files, sent_form, text_in

router = APIRouter(include_in_schema=False)

_REFUSED = 422


@router.get("/studies/new")
def new_study(request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The form to begin a study."""
    return _new(request, app, caller)


@router.post("/drafts")
async def begin(request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Begin a draft from the form and its files."""
    if not access.may_make_studies(caller):
        await drain(request)
        raise _no_maker(caller)
    try:
        await run_in_threadpool(drafts.require_room, app, caller, _coming(request))
    except NoRoomError as error:
        await drain(request)
        return await run_in_threadpool(_new, request, app, caller, [f"{error}."])
    try:
        async with sent_form(request, app, caller) as form:
            name, sent = text_in(form, "name"), sent_files(form)
            draft = await run_in_threadpool(drafts.begin, app, caller, name, sent)
    except UploadRefusedError as error:
        return await run_in_threadpool(_new, request, app, caller, error.faults)
    except NoRoomError as error:
        return await run_in_threadpool(_new, request, app, caller, [f"{error}."])
    return _to(draft)


@router.get("/drafts/{public_id}")
def look(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The page of a draft: its files and faults."""
    return _draft_page(request, caller, drafts.find(app, caller, public_id), app)


@router.post("/drafts/{public_id}/files")
async def add(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Add files to a draft."""
    try:
        draft = await run_in_threadpool(drafts.find, app, caller, public_id)
    except NotFoundError:
        await drain(request)
        raise
    try:
        await run_in_threadpool(disk_quota.require, app.settings, draft.folder, _coming(request))
    except NoRoomError as error:
        await drain(request)
        return await run_in_threadpool(_draft_page, request, caller, draft, app, [f"{error}."])
    try:
        async with sent_form(request, app, caller) as form:
            await run_in_threadpool(drafts.add, app, caller, draft, sent_files(form))
    except UploadRefusedError as error:
        return await run_in_threadpool(_draft_page, request, caller, draft, app, error.faults)
    except NoRoomError as error:
        return await run_in_threadpool(_draft_page, request, caller, draft, app, [f"{error}."])
    return _to(draft)


@router.post("/drafts/{public_id}/remove", dependencies=[OwnForm])
def remove(public_id: str, app: AppDep, caller: SignedIn, file: Annotated[str, Form()]) -> Response:
    """Remove a file from a draft."""
    draft = drafts.find(app, caller, public_id)
    drafts.remove(app, draft, file)
    return _to(draft)


@router.get("/drafts/{public_id}/text")
def text(public_id: str, request: Request, app: AppDep, caller: SignedIn, file: str) -> Response:
    """The form to edit a text file of a draft."""
    draft = drafts.find(app, caller, public_id)
    return _text_page(request, app, caller, draft, file)


@router.post("/drafts/{public_id}/text", dependencies=[OwnForm])
def write(
    public_id: str,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    file: Annotated[str, Form()],
    text: Annotated[str, Form()] = "",
    base: Annotated[str | None, Form(max_length=100)] = None,
) -> Response:
    """Store an edited text file."""
    draft = drafts.find(app, caller, public_id)
    try:
        drafts.write_text(app, draft, file, text, base)
    except ChangedMeanwhileError:
        return _text_page(request, app, caller, draft, file, text.replace("\r\n", "\n"))
    return _to(draft)


@router.post("/drafts/{public_id}/create", dependencies=[OwnForm])
def create(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Create the study from a draft without faults."""
    draft = drafts.find(app, caller, public_id)
    try:
        info = drafts.create_study(app, caller, draft)
    except StudyFaults:
        # The page names every one.
        return _draft_page(request, caller, draft, app, status=_REFUSED)
    except ConflictError as error:
        return _draft_page(request, caller, draft, app, [f"{error}."])
    return RedirectResponse(f"/studies/{info.slug}", status_code=303)


@router.post("/drafts/{public_id}/mend", dependencies=[OwnForm])
def mend(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Put the slips of YAML in the plan right."""
    draft = drafts.find(app, caller, public_id)
    try:
        drafts.mend_plan(app, draft)
    except UploadRefusedError as error:
        return _draft_page(request, caller, draft, app, error.faults)
    return _to(draft)


@router.post("/drafts/{public_id}/parameters", dependencies=[OwnForm])
def take_parameters(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Write the parameters of the table into the plan."""
    draft = drafts.find(app, caller, public_id)
    try:
        drafts.take_parameters(app, draft)
    except UploadRefusedError as error:
        return _draft_page(request, caller, draft, app, error.faults)
    return _to(draft)


@router.post("/drafts/{public_id}/transcode", dependencies=[OwnForm])
def transcode(public_id: str, app: AppDep, caller: SignedIn) -> Response:
    """Start a job that transcodes the videos some browsers cannot play."""
    draft = drafts.find(app, caller, public_id)
    drafts.transcode(app, caller, draft)
    return _to(draft)


@router.post("/drafts/{public_id}/discard", dependencies=[OwnForm])
def discard(public_id: str, app: AppDep, caller: SignedIn) -> Response:
    """Delete a draft."""
    drafts.discard(app, drafts.find(app, caller, public_id, whole=False))
    return RedirectResponse("/studies", status_code=303)


def _text_page(
    request: Request,
    app: AppContext,
    caller: Principal,
    draft: Draft,
    file: str,
    typed: str | None = None,
) -> Response:
    """The form to edit a text. typed: refused input, if the text was changed by another request."""
    stored = drafts.text_of(draft, file)
    return experimenter_page(
        request,
        caller,
        "experimenter/draft_text.html",
        file,
        status_code=200 if typed is None else 409,
        draft=draft,
        file=file,
        text=stored if typed is None else typed,
        base=text_hash(stored),
        lines=() if typed is None else difference(stored, typed),
        rendered=Markup(render(stored)) if file.endswith(".md") else None,  # noqa: S704
        faults=drafts.check(app, draft).faults.get(file, ()),
        grouped=grouped,
    )


def _to(draft: Draft) -> Response:
    return RedirectResponse(f"/drafts/{draft.public_id}", status_code=303)


def _coming(request: Request) -> int:
    """Disk space that a form needs, in bytes: files exist twice, as received and in the draft."""
    said = request.headers.get("content-length", "")
    return 2 * int(said) if said.isdecimal() and len(said) < 16 else 0


def _no_maker(caller: Principal) -> ForbiddenError:
    return ForbiddenError(f"{caller.email} ({caller.role.value}) may not make studies")


def _new(
    request: Request, app: AppContext, caller: Principal, refused: Sequence[str] = ()
) -> Response:
    if not access.may_make_studies(caller):
        raise _no_maker(caller)
    return experimenter_page(
        request,
        caller,
        "experimenter/new_study.html",
        "Make a study",
        status_code=_REFUSED if refused else 200,
        refused=refused,
        limit_mb=app.settings.upload_limit_mb,
        most_files=MOST_FILES,
    )


def _draft_page(
    request: Request,
    caller: Principal,
    draft: Draft,
    app: AppContext,
    refused: Sequence[str] = (),
    status: int = 200,
) -> Response:
    jobs.restart_stalled(app)
    checked = drafts.check(app, draft)
    files = drafts.files(draft)
    present = {file.name for file in files}
    more: dict[str, Any] = {}
    if checked.study is not None:
        plan = checked.study.plan
        more["study"] = {
            "slug": plan.slug,
            "replaces": drafts.replaces(app, draft, plan.slug),
            "title": plan.text(plan.title, plan.default_language),
            "conditions": len(plan.conditions),
            "trials": plan.trials,
            "queries": plan.shown_per_trial,
            "recordings": len(checked.study.recordings),
            "has_ranges": plan.has_ranges,
        }
    return experimenter_page(
        request,
        caller,
        "experimenter/draft.html",
        draft.name,
        status_code=_REFUSED if refused else status,
        draft=draft,
        checked=checked,
        steps=steps(checked.faults),
        files=files,
        present=present,
        grouped=grouped,
        in_lines=in_lines,
        refused=refused,
        limit_mb=app.settings.upload_limit_mb,
        most_files=MOST_FILES,
        kept_until=expired_drafts.kept_until(app, draft),
        kept_days=app.settings.drafts_kept_days,
        job=jobs.newest(app, transcode_job.KIND, draft=draft.public_id),
        **{"study": None, **more},
    )
