"""The people of a study: its members, and deletion of participants' data."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.services.accounts.accounts import LONGEST_ADDRESS, Principal
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError
from app.services.sessions import participants, withdrawal
from app.services.sessions.participants import Person
from app.services.studies import sharing
from app.services.studies.repository import StudyInfo
from app.web.api.export_routes import person_response
from app.web.http.security import AppDep

from .page_context import ChangeOf, DataOf, OwnerOf, OwnForm, SignedIn
from .study_frame import study_page

router = APIRouter(prefix="/studies/{slug}/people", include_in_schema=False)

#: Newer ones are those who ask; the others are found by what they are called.
SHOWN = 50


@router.get("")
def people(
    study: DataOf, request: Request, app: AppDep, caller: SignedIn, deleted: str = ""
) -> Response:
    """The page of members and recent sessions."""
    return _page(request, app, caller, study, was_deleted=bool(deleted))


@router.post("/share", dependencies=[OwnForm])
def share(
    study: OwnerOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    email: Annotated[str, Form(max_length=LONGEST_ADDRESS)],
) -> Response:
    """Give an account access to the study."""
    try:
        sharing.share(app, study.slug, email, caller.email)
    except (ConflictError, NotFoundError) as error:
        return _page(request, app, caller, study, status=409, share_fault=str(error))
    return _back(study)


@router.post("/unshare", dependencies=[OwnForm])
def unshare(
    study: OwnerOf, app: AppDep, caller: SignedIn, account_id: Annotated[int, Form()]
) -> Response:
    """Remove an account's access to the study."""
    sharing.stop_sharing(app, study.slug, account_id, caller.email)
    return _back(study)


@router.post("/delete-by-receipt", dependencies=[OwnForm])
def delete_by_receipt(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    receipt: Annotated[str, Form(max_length=100)],
) -> Response:
    """Delete the data of the participant with this receipt code."""
    try:
        withdrawal.delete_by_receipt(app, study.slug, receipt, caller.email)
    except NotFoundError:
        fault = "Nothing is kept under this code: it is not quite right, or all is deleted already."
        return _page(request, app, caller, study, status=404, receipt_fault=fault)
    return _back(study, "?deleted=yes")


@router.post("/find", dependencies=[OwnForm])
def find(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    who: Annotated[str, Form(max_length=200)],
) -> Response:
    """The participants who are called so: by pseudonym, receipt code or platform id.

    A form by POST, so that a platform's id stands in no address.
    """
    try:
        found = participants.find_by_any(app, study.slug, study.id, who)
    except NotFoundError as error:
        return _page(request, app, caller, study, status=404, person_fault=str(error))
    return _page(request, app, caller, study, found=found)


@router.get("/data.zip")
def data(study: ChangeOf, app: AppDep, caller: SignedIn, participant: str) -> Response:
    """Everything that is stored of one participant."""
    person = participants.find(app, study.id, participant)
    return person_response(app, caller, study, person.pseudonym)


@router.get("/delete")
def ask_to_delete(
    study: ChangeOf, request: Request, app: AppDep, caller: SignedIn, participant: str
) -> Response:
    """The confirmation page before a deletion."""
    try:
        person = participants.find(app, study.id, participant)
    except NotFoundError as error:
        return _page(request, app, caller, study, status=404, person_fault=str(error))
    return study_page(request, app, caller, study, "delete_person", person=person)


@router.post("/delete", dependencies=[OwnForm])
def delete(
    study: ChangeOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    participant: Annotated[str, Form(max_length=24)],
) -> Response:
    """Delete a participant's data."""
    try:
        withdrawal.delete_participant(app, study.slug, participant, caller.email)
    except NotFoundError as error:
        return _page(request, app, caller, study, status=404, person_fault=str(error))
    return _back(study, "?deleted=yes")


def _back(study: StudyInfo, query: str = "") -> Response:
    return RedirectResponse(f"/studies/{study.slug}/people{query}", status_code=303)


def _page(
    request: Request,
    app: AppContext,
    caller: Principal,
    study: StudyInfo,
    *,
    status: int = 200,
    was_deleted: bool = False,
    found: list[Person] | None = None,
    **faults: str,
) -> Response:
    nothing: dict[str, Any] = dict.fromkeys(("share_fault", "receipt_fault", "person_fault"))
    return study_page(
        request,
        app,
        caller,
        study,
        "people",
        status_code=status,
        ties=sharing.members(app, study.slug),
        persons=participants.newest(app, study.id, SHOWN) if found is None else found,
        persons_in_all=participants.count(app, study.id) if found is None else len(found),
        is_search=found is not None,
        was_deleted=was_deleted,
        **{**nothing, **faults},
    )
