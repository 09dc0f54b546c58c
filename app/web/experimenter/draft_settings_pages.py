"""The form for common settings of a study; it edits the same `study.yaml` as the text editor."""

from __future__ import annotations

from collections.abc import Mapping

from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.drafts.drafts import Draft
from app.services.drafts.uploads import UploadRefusedError
from app.services.runtime.errors import ChangedMeanwhileError
from app.study import plan_form
from app.study.plan_source import STUDY_FILE
from app.study.plan_validation import METHODS
from app.study.recruitment import PLATFORMS
from app.study.text_diff import text_hash
from app.study.yaml_edit import UneditableError
from app.study.yaml_source import YamlSyntaxError
from app.web.http.security import AppDep

from .page_context import OwnForm, SignedIn, experimenter_page

router = APIRouter(include_in_schema=False)

#: Lines for conditions, and for parameters, that are not there yet.
_FURTHER = 2


@router.get("/drafts/{public_id}/settings")
def settings(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """The form with the settings of a draft's `study.yaml`."""
    return _page(request, app, caller, drafts.find(app, caller, public_id))


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    draft: Draft,
    typed: Mapping[str, str] | None = None,
) -> Response:
    """The form. typed: refused fields, if the file was changed by another request."""
    text = drafts.text_of(draft, STUDY_FILE)
    try:
        stored = plan_form.fields(text)
        environments = plan_form.environments(text)
    except YamlSyntaxError as error:
        raise _by_hand(error) from None
    values = {**stored, **(typed or {})}
    there = sum(name.startswith("name:") for name in stored)
    return experimenter_page(
        request,
        caller,
        "experimenter/draft_settings.html",
        "Settings",
        status_code=200 if typed is None else 409,
        draft=draft,
        values=values,
        base=text_hash(text),
        is_refused=typed is not None,
        differing=[
            (name, stored.get(name, ""), value.strip())
            for name, value in (typed or {}).items()
            if value.strip() != stored.get(name, "") and not _of_no_condition(name, values)
        ],
        languages=[name.partition(":")[2] for name in values if name.startswith("title:")],
        rows=there + _FURTHER,
        parameter_rows=sum(name.startswith("parameter:") for name in stored) + _FURTHER,
        environments=environments,
        methods=METHODS,
        with_skip=[method.name for method in METHODS if method.allows_skip],
        platforms=PLATFORMS,
        outcomes=plan_form.OUTCOMES,
    )


@router.post("/drafts/{public_id}/settings", dependencies=[OwnForm])
async def save(public_id: str, request: Request, app: AppDep, caller: SignedIn) -> Response:
    """Write the form's settings into the draft's `study.yaml`."""
    form = await request.form()
    given = {
        # A browser sends lines of a text ended by both characters.
        name: value.replace("\r\n", "\n")
        for name, value in form.items()
        if isinstance(value, str) and name not in ("csrf_token", "base")
    }
    base = form.get("base")
    said = base if isinstance(base, str) and base else None
    return await run_in_threadpool(_save, request, app, caller, public_id, given, said)


def _save(
    request: Request,
    app: AppContext,
    caller: Principal,
    public_id: str,
    given: dict[str, str],
    base: str | None,
) -> Response:
    draft = drafts.find(app, caller, public_id)
    text = drafts.text_of(draft, STUDY_FILE)
    if base is not None and base != text_hash(text):
        return _page(request, app, caller, draft, given)
    try:
        written = plan_form.written(text, given)
        drafts.write_text(app, draft, STUDY_FILE, written, text_hash(text))
    except ChangedMeanwhileError:
        return _page(request, app, caller, draft, given)
    except (UneditableError, YamlSyntaxError) as error:
        raise _by_hand(error) from None
    return RedirectResponse(f"/drafts/{draft.public_id}", status_code=303)


def _of_no_condition(field: str, values: Mapping[str, str]) -> bool:
    """Whether a field belongs to one of the lines for further conditions that was left empty."""
    name, _, index = field.partition(":")
    return name in ("method", "environment") and not values.get(f"name:{index}", "").strip()


def _by_hand(error: Exception) -> UploadRefusedError:
    return UploadRefusedError([f"{STUDY_FILE} has to be put right by hand first: {error}."])
