"""A study's people: sharing it, and deleting for somebody who asks."""

from __future__ import annotations

import io
import re
import zipfile

import httpx
import pytest
from sqlalchemy import select

from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.studies import sharing
from app.services.studies.repository import StudyInfo
from app.storage.models.accounts import StudyAccess
from app.storage.models.studies import Identity, Participant, Study

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_experimenter_pages import form_token, sign_in
from .test_leaving import rows_of_people

BOB = "bob@lab.example"
CAROL = "carol@lab.example"
PEOPLE = "/studies/short/people"


@pytest.fixture
def owner(client: Api, app: AppContext, short_study: StudyInfo, api_token: str) -> Api:
    """Bob, whose study it is, is signed in; Carol has an account; Ada is an admin."""
    bob = accounts.create(app, BOB, PASSWORD)
    accounts.create(app, CAROL, PASSWORD)
    with app.database.write() as db:
        db.add(
            StudyAccess(
                study_id=short_study.id,
                account_id=bob.account_id,
                access="owner",
                created_at=app.now(),
            )
        )
    assert sign_in(client, BOB).status_code == 303
    return client


def send(client: Api, action: str, **fields: str) -> httpx.Response:
    token = form_token(client.get(PEOPLE))
    return client.post(f"{PEOPLE}/{action}", data={"csrf_token": token, **fields})


def pseudonyms(app: AppContext) -> list[str]:
    with app.database.read() as db:
        return list(db.scalars(select(Participant.pseudonym).order_by(Participant.id)))


def test_a_study_is_shared_and_taken_back(owner: Api, app: AppContext) -> None:
    for _ in range(2):
        assert send(owner, "share", email=f" {CAROL.upper()}").status_code == 303
    assert [(tie.email, tie.is_owner) for tie in sharing.members(app, "short")] == [
        (BOB, True),
        (CAROL, False),
    ]
    owner.cookies.clear()
    sign_in(owner, CAROL)
    page = owner.get(PEOPLE).text
    assert owner.get("/studies/short").status_code == 200
    assert CAROL in page
    # Who it is shared with does not share it on, nor takes it from others.
    assert "/people/share" not in page
    assert send(owner, "share", email=EMAIL).status_code == 403
    carol = str(accounts.find(app, CAROL).account_id)
    assert send(owner, "unshare", account_id=carol).status_code == 403
    owner.cookies.clear()
    sign_in(owner, BOB)
    assert send(owner, "unshare", account_id=carol).status_code == 303
    assert send(owner, "unshare", account_id=carol).status_code == 404
    owner.cookies.clear()
    sign_in(owner, CAROL)
    assert owner.get("/studies/short").status_code == 404
    done = [(line.action, line.actor) for line in audit_log.trail(app, "short")]
    assert done[:2] == [("sharing ended", BOB), ("study shared", BOB)]


def test_whom_a_study_cannot_be_shared_with_is_said(owner: Api, app: AppContext) -> None:
    accounts.create(app, "rev@board.example", PASSWORD, Role.REVIEWER)
    for address, said in [
        ("nobody@lab.example", "there is no account of"),
        ("rev@board.example", "is a reviewer"),
    ]:
        page = send(owner, "share", email=address)
        assert (page.status_code, said in page.text) == (409, True)
    # An owner stays one.
    send(owner, "share", email=BOB)
    bob = str(accounts.find(app, BOB).account_id)
    assert send(owner, "unshare", account_id=bob).status_code == 404
    assert [tie.is_owner for tie in sharing.members(app, "short")] == [True]


def test_a_receipt_that_somebody_sent_deletes_them(owner: Api, app: AppContext) -> None:
    answer = owner.post("/api/v1/studies/short/sessions", json={}).json()
    wrong = send(owner, "delete-by-receipt", receipt="7KQ2-MXRD-9FWT-4BHC")
    assert (wrong.status_code, "Nothing is kept under this code" in wrong.text) == (404, True)
    done = send(owner, "delete-by-receipt", receipt=answer["receipt"].lower())
    assert done.headers["location"] == f"{PEOPLE}?deleted=yes"
    assert "is deleted" in owner.get(done.headers["location"]).text
    assert rows_of_people(app)["tombstones"] == 1
    assert pseudonyms(app) == []


def test_a_participant_is_deleted_after_a_question(owner: Api, app: AppContext) -> None:
    stays = owner.start().to_first_query()
    owner.start().to_first_query().respond("left")
    first, second = pseudonyms(app)
    page = owner.get(PEOPLE).text
    links = re.findall(rf'href="({PEOPLE}/delete\?participant=[^"]+)"', page)
    assert [link.rsplit("=")[-1] for link in links] == [second, first]
    asked = owner.get(links[0])
    assert f"Delete {second}?" in asked.text
    assert pseudonyms(app) == [first, second]
    assert send(owner, "delete", participant=second).status_code == 303
    assert pseudonyms(app) == [first]
    assert stays.look()["stage"] == "query"
    line = audit_log.trail(app, "short")[0]
    assert (line.actor, line.action) == (BOB, "participant deleted")
    # The trail is never changed: a pseudonym in it would stay.
    assert second not in str(line.details)


def test_a_pseudonym_is_found_however_it_is_typed(owner: Api, app: AppContext) -> None:
    owner.start()
    (name,) = pseudonyms(app)
    found = owner.get(f"{PEOPLE}/delete", params={"participant": f" {name.lower()} "})
    assert f"Delete {name}?" in found.text
    for unknown in ("P-2222-2222", "<b>", "' OR 1=1"):
        page = owner.get(f"{PEOPLE}/delete", params={"participant": unknown})
        assert (page.status_code, "is none" in page.text) == (404, True)
        assert "<b>" not in page.text
        assert send(owner, "delete", participant=unknown).status_code == 404
    assert pseudonyms(app) == [name]


def test_everything_of_one_person_is_downloaded_and_they_are_found_by_what_they_know(
    owner: Api, app: AppContext
) -> None:
    answer = owner.post("/api/v1/studies/short/sessions", json={}).json()
    owner.start().to_first_query().respond("left")
    mine, others = pseudonyms(app)
    with app.database.write() as db:
        of = db.scalar(select(Participant.id).where(Participant.pseudonym == mine))
        db.add(
            Identity(participant_id=of, key="PROLIFIC_PID", value="5f0aabc", created_at=app.now())
        )
    for called in (mine.lower(), f" {answer['receipt']} ", "5f0aabc"):
        page = send(owner, "find", who=called).text
        assert f"people/data.zip?participant={mine}" in page
        assert others not in page
    missing = send(owner, "find", who="<5f0>")
    assert (missing.status_code, "is none in this study" in missing.text) == (404, True)
    assert "<5f0>" not in missing.text

    packed = owner.get(f"{PEOPLE}/data.zip", params={"participant": others})
    assert packed.status_code == 200
    archive = zipfile.ZipFile(io.BytesIO(packed.content))
    tables = {name: archive.read(name).decode() for name in archive.namelist()}
    assert len(tables["queries.csv"].splitlines()) == 3
    assert "deletions.csv" not in tables
    assert not any(mine in table for table in tables.values())
    mine_too = owner.get(f"{PEOPLE}/data.zip", params={"participant": mine}).content
    assert b"5f0aabc" in zipfile.ZipFile(io.BytesIO(mine_too)).read("identities.csv")
    # The trail says that somebody's data were taken, and not whose: it outlives a deletion.
    line = audit_log.trail(app, "short")[0]
    assert line.action == "identities exported"
    assert mine not in str(line.details)


def test_nobody_of_another_study_is_deleted(
    owner: Api, app: AppContext, short_study: StudyInfo
) -> None:
    with app.database.write() as db:
        others = short_study.id + 1
        db.add(Study(id=others, slug="other", status="open", created_at=app.now()))
        db.flush()
        db.add(Participant(study_id=others, pseudonym="P-XXXX-XXXX", created_at=app.now()))
    assert send(owner, "delete", participant="P-XXXX-XXXX").status_code == 404
    assert pseudonyms(app) == ["P-XXXX-XXXX"]


def test_the_studys_own_trail_is_read_by_those_who_run_it(owner: Api, app: AppContext) -> None:
    send(owner, "share", email=CAROL)
    page = owner.get("/studies/short/activity").text
    assert "study shared" in page
    assert "signed in" not in page
    assert owner.get("/activity").status_code == 403
