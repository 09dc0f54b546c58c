"""A deleted study says that it is gone, with the way back for those who were in it."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.maintenance import periodic_tasks
from app.services.studies import deleted_studies, lifecycle, repository
from app.storage.models.arrivals import DeletedSession, DeletedStudy
from tests.conftest import Clock

from .client import Api, Session
from .conftest import Recruit
from .own_study import write_own_study
from .test_crowding import rows
from .test_participant_pages import COOKIE, heading
from .test_recruitment import BACK_TO_PROLIFIC, PROLIFIC, return_link

GONE = "This study has ended"
PROBLEM = "urn:pbpo-studio:problem:study-deleted"


@pytest.fixture
def inside(client: Api, recruit: Recruit) -> Session:
    """Somebody from Prolific who is at a pair."""
    recruit(PROLIFIC)
    return client.start(external_ids={"PROLIFIC_PID": "5f0c1ada"}).to_first_query()


def delete(app: AppContext, slug: str = "short") -> None:
    repository.close_study(app, slug)
    lifecycle.delete(app, slug, typed=slug)


@pytest.mark.parametrize("page", ["", "/withdraw", "/delete", "/privacy", "/deleted", "?lang=en"])
def test_every_page_of_a_deleted_study_says_so(
    client: Api, app: AppContext, inside: Session, page: str
) -> None:
    delete(app)
    client.cookies.set(COOKIE, inside.token)
    answer = client.get(f"/s/short{page}", follow_redirects=True)
    assert (answer.status_code, heading(answer)) == (410, GONE)
    assert return_link(answer.text) == f"{BACK_TO_PROLIFIC}OURFAULT4"
    assert "5f0c1ada" not in answer.text
    client.cookies.clear()
    stranger = client.get(f"/s/short{page}", follow_redirects=True)
    assert (stranger.status_code, heading(stranger)) == (410, GONE)
    assert "OURFAULT4" not in stranger.text


@pytest.mark.parametrize("form", ["consent", "continue", "withdraw", "delete", "decline"])
def test_a_form_of_a_deleted_study_ends_there_too(
    client: Api, app: AppContext, inside: Session, form: str
) -> None:
    delete(app)
    data = {"version": "1", "receipt": "7KQ2-MXRD-9FWT-4BHC"}
    answer = client.post(f"/s/short/{form}", data=data, follow_redirects=True)
    assert (answer.status_code, heading(answer)) == (410, GONE)


def test_calls_are_told_and_whoever_was_inside_has_the_code(
    client: Api, app: AppContext, inside: Session
) -> None:
    url = inside.state["query"]["left"]["url"]
    delete(app)
    body = {"query_id": inside.state["query"]["id"], "response": "left", "rt_ms": 1}
    by_cookie = {"PBPO-Study": "short"}
    client.cookies.set(COOKIE, inside.token)
    for answer in (
        client.get("/api/v1/session", headers=inside.headers),
        client.post("/api/v1/session/responses", json=body, headers=inside.headers),
        client.post("/api/v1/session/responses", json=body, headers=by_cookie),
    ):
        assert (answer.status_code, answer.json()["type"]) == (410, PROBLEM)
        assert answer.json()["way_back"]["code"] == "OURFAULT4"
    client.cookies.clear()
    for call, sent in (("sessions", {}), ("deletions", {"receipt": "7KQ2-MXRD-9FWT-4BHC"})):
        answer = client.post(f"/api/v1/studies/short/{call}", json=sent)
        assert (answer.status_code, answer.json()["type"]) == (410, PROBLEM)
        assert answer.json()["way_back"] is None
    assert client.get(url).status_code == 410


def test_nothing_else_is_told_of_it(client: Api, app: AppContext, inside: Session) -> None:
    assert client.get("/s/never").status_code == 404
    delete(app)
    assert client.get("/s/never").status_code == 404
    assert client.get("/api/v1/session").status_code == 401
    unknown = client.get("/api/v1/session", headers={"Authorization": "Bearer nobody"})
    assert unknown.status_code == 401
    # Experimenters' pages tell nobody which studies others have had.
    assert client.get("/api/v1/studies/short/export.zip").status_code == 401


def test_those_who_had_left_by_themselves_are_owed_nothing(
    client: Api, app: AppContext, inside: Session
) -> None:
    inside.call("withdraw")
    delete(app)
    client.cookies.set(COOKIE, inside.token)
    page = client.get("/s/short")
    assert (page.status_code, heading(page)) == (410, GONE)
    assert "OURFAULT4" not in page.text


def test_a_draft_that_is_thrown_away_leaves_nothing(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    repository.create(app, repository.load_folder(str(write_own_study(tmp_path / "kettles"))))
    lifecycle.delete(app, "kettles")
    assert rows(app, DeletedStudy) == 0
    assert client.get("/s/kettles").status_code == 404


def test_a_slug_can_be_used_anew_and_deleted_again(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    folder = repository.load_folder(str(write_own_study(tmp_path / "kettles")))
    for _ in range(2):
        repository.create(app, folder)
        repository.open_study(app, "kettles")
        assert client.get("/s/kettles").status_code == 200
        client.start("kettles").to_first_query()
        delete(app, "kettles")
        assert client.get("/s/kettles").status_code == 410
    assert rows(app, DeletedStudy) == 1


def test_whose_sessions_they_were_is_forgotten_after_a_month(
    client: Api, app: AppContext, inside: Session, clock: Clock
) -> None:
    delete(app)
    assert rows(app, DeletedSession) == 1
    clock.forward(timedelta(days=29).total_seconds())
    assert deleted_studies.sweep(app) == 0
    clock.forward(timedelta(days=2).total_seconds())
    periodic_tasks.run_all(app)
    assert (rows(app, DeletedSession), rows(app, DeletedStudy)) == (0, 1)
    assert client.get("/s/short").status_code == 410
