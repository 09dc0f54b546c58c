"""The form for a study's common settings, which writes the same `study.yaml` as one's own hand."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse, Response

from app.services import drafts
from app.services.accounts import Experimenter
from app.services.studio import Studio
from app.services.uploads import UploadRefusedError
from app.study import plan_form
from app.study.consistency import METHODS
from app.study.plan_source import STUDY_FILE
from app.study.recruitment import PLATFORMS
from app.study.yaml_edit import UneditableError
from app.study.yaml_source import YamlSyntaxError

from .desk import OwnForm, SignedIn, desk_page
from .security import StudioDep

router = APIRouter(include_in_schema=False)

#: Lines for conditions that are not there yet.
_FURTHER = 2


@router.get("/drafts/{public_id}/settings")
def settings(public_id: str, request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    draft = drafts.find(studio, caller, public_id)
    text = drafts.text_of(draft, STUDY_FILE)
    try:
        values = plan_form.fields(text)
        environments = plan_form.environments(text)
    except YamlSyntaxError as error:
        raise _by_hand(error) from None
    there = sum(name.startswith("name:") for name in values)
    return desk_page(
        request,
        caller,
        "experimenter/draft_settings.html",
        "Settings",
        draft=draft,
        values=values,
        languages=[name.partition(":")[2] for name in values if name.startswith("title:")],
        rows=there + _FURTHER,
        environments=environments,
        methods=METHODS,
        with_skip=[method.name for method in METHODS if method.allows_skip],
        platforms=PLATFORMS,
        outcomes=plan_form.OUTCOMES,
    )


@router.post("/drafts/{public_id}/settings", dependencies=[OwnForm])
async def save(public_id: str, request: Request, studio: StudioDep, caller: SignedIn) -> Response:
    form = await request.form()
    given = {
        name: value
        for name, value in form.items()
        if isinstance(value, str) and name != "csrf_token"
    }
    return await run_in_threadpool(_save, studio, caller, public_id, given)


def _save(studio: Studio, caller: Experimenter, public_id: str, given: dict[str, str]) -> Response:
    draft = drafts.find(studio, caller, public_id)
    text = drafts.text_of(draft, STUDY_FILE)
    try:
        drafts.write_text(studio, draft, STUDY_FILE, plan_form.written(text, given))
    except (UneditableError, YamlSyntaxError) as error:
        raise _by_hand(error) from None
    return RedirectResponse(f"/drafts/{draft.public_id}", status_code=303)


def _by_hand(error: Exception) -> UploadRefusedError:
    return UploadRefusedError([f"{STUDY_FILE} has to be put right by hand first: {error}."])
