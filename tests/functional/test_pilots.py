"""Pilots: people try a study by a link of its own, and nothing of it counts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, Clock, write_study

from .client import Api
from .conftest import EMAIL, Recruit
from .desk import Desk
from .test_commands import Run, pbpo
from .test_leaving import rows_of_people
from .test_participant_pages import HEADINGS, heading, token_for, version

__all__ = ["pbpo"]

HERE = "/pilot/s/short"
SESSIONS = "/api/v1/studies/short/sessions"
CODES = (
    "recruitment: {platform: prolific, codes: {completed: CODE-DONE, withdrawn: CODE-LEFT,"
    " declined: CODE-NO}}\n"
)


def link_of(desk: Desk) -> str:
    """Path and query of a new pilot link, as the Recruit page shows it."""
    page = desk.post("/studies/short/pilot/link")
    found = re.search(r"http://testserver(/pilot/s/short\?entry=[\w-]{43})<", page.text)
    assert found, page.text
    desk.client.cookies.clear()
    return found[1]


def agree_by(client: Api, link: str) -> None:
    path, _, query = link.partition("?")
    sent = client.post(f"{path}/consent?{query}", data={"version": version(client.get(link))})
    assert (sent.status_code, sent.headers["location"]) == (303, HERE)


@pytest.fixture
def desk(client: Api, app: AppContext, short_study: StudyInfo) -> Desk:
    return Desk(client, app, EMAIL, Role.ADMIN)


def test_whoever_has_the_link_begins_a_pilot_and_is_told_on_every_page(
    desk: Desk, app: AppContext
) -> None:
    client, link = desk.client, link_of(desk)
    assert heading(client.get(link)) == HEADINGS["consent"]
    agree_by(client, link)
    for path in (HERE, f"{HERE}/withdraw", f"{HERE}/privacy"):
        page = client.get(path)
        assert (page.status_code, 'data-testid="mode-pilot"' in page.text) == (200, True), path
        assert 'href="/s/' not in page.text
    # Nobody in a pilot is led to the experimenters' pages.
    assert "/studies/" not in client.get(HERE).text
    told = client.get("/api/v1/session", headers={"PBPO-Study": "pilot/short"})
    assert told.json()["stage"] == "instructions"


@pytest.mark.parametrize("query", ["", "?entry=", "?entry=made-up", "?key=x"])
def test_without_the_link_nobody_begins_one(desk: Desk, app: AppContext, query: str) -> None:
    client = desk.client
    client.cookies.clear()
    for _ in range(2):
        assert client.get(f"{HERE}{query}").status_code == 403
        consent = client.post(f"{HERE}/consent{query}", data={"version": "x"})
        assert consent.status_code == 403
        link_of(desk)
    assert rows_of_people(app).keys() == {"sign_ins"}


def test_another_link_or_its_end_lets_nobody_in_by_the_first(desk: Desk) -> None:
    first = link_of(desk)
    second = link_of(desk)
    assert desk.client.get(first).status_code == 403
    assert heading(desk.client.get(second)) == HEADINGS["consent"]
    assert 'data-testid="has-pilot"' in desk.get("/studies/short/recruit").text
    desk.post("/studies/short/pilot/end")
    desk.client.cookies.clear()
    assert desk.client.get(second).status_code == 403


def test_a_pilot_is_left_out_of_results_unless_it_is_asked_for(desk: Desk, app: AppContext) -> None:
    client = desk.client
    agree_by(client, link_of(desk))
    client.start()
    desk.get("/studies")
    shown = desk.get("/studies/short").text
    assert shown.count("<tr data-session=") == 1
    assert desk.get("/studies/short?mode=pilot").text.count("<tr data-session=") == 1
    for mode, modes in (("live", ["live"]), ("pilot", ["pilot"]), ("all", ["live", "pilot"])):
        table = desk.get(f"/api/v1/studies/short/export/sessions.csv?mode={mode}").text
        assert sorted(re.findall(r",(live|pilot),", table)) == modes


def test_the_command_line_exports_pilots(
    desk: Desk, pbpo: Run, tmp_path_factory: pytest.TempPathFactory
) -> None:
    agree_by(desk.client, link_of(desk))
    for mode, rows in ((None, 0), ("pilot", 1)):
        out = tmp_path_factory.mktemp("export") / "short"
        words = ["--mode", mode] if mode else []
        assert pbpo("export", "short", "--out", out, *words).status == 0
        assert len((out / "sessions.csv").read_text().splitlines()) == rows + 1


def test_a_pilot_takes_no_place_and_weighs_in_no_balance(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("places: 1\n")
    desk = Desk(client, app, EMAIL, Role.ADMIN)
    link = link_of(desk)
    for _ in range(3):
        agree_by(client, link)
        client.cookies.clear()
    assert 'data-testid="places-taken">0<' in desk.get("/studies/short/recruit").text
    client.start()
    # The study is full, and a pilot is none of its places.
    client.cookies.clear()
    assert heading(client.get(link)) == HEADINGS["consent"]


@pytest.mark.parametrize("end", ["completed", "withdrawn", "declined"])
def test_no_pilot_is_given_a_code(
    client: Api, recruit: Recruit, app: AppContext, clock: Clock, end: str
) -> None:
    recruit(CODES)
    session = client.start(mode="pilot", by=token_for(app)).to_stage(end, clock.forward)
    client.cookies.set("pbpo_pilot_session_short", session.token)
    page = client.get(HERE)
    assert page.status_code == 200
    for text in (page.text, str(session.look()), client.get(f"{HERE}/deleted").text):
        assert "CODE-" not in text


def test_by_a_call_pilots_are_experimenters(desk: Desk, app: AppContext) -> None:
    client = desk.client
    token = link_of(desk).partition("=")[2]
    for body in ({"mode": "pilot"}, {"mode": "pilot", "entry": token}):
        assert client.post(SESSIONS, json=body).status_code == 403


def test_a_participants_link_after_a_pilot_begins_a_live_session(desk: Desk) -> None:
    client = desk.client
    agree_by(client, link_of(desk))
    assert heading(client.get("/s/short")) == HEADINGS["consent"]


def test_a_draft_has_a_pilot_and_a_closed_study_none(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    folder = write_study(tmp_path / "study", SHORT_PLAN)
    repository.create(app, repository.load_folder(str(folder)))
    desk = Desk(client, app, EMAIL, Role.ADMIN)
    link = link_of(desk)
    agree_by(client, link)
    client.cookies.clear()
    repository.open_study(app, "short")
    assert heading(client.get(link)) == HEADINGS["consent"]
    repository.close_study(app, "short")
    assert client.get(link).status_code == 409
    assert desk.post("/studies/short/pilot/link").status_code == 409


def test_a_pilots_link_is_made_by_command(short_study: StudyInfo, client: Api, pbpo: Run) -> None:
    link = pbpo("link", "pilot", "short", "--address", "https://lab.example").out.strip()
    assert link.startswith("https://lab.example/pilot/s/short?entry=")
    assert heading(client.get(link.removeprefix("https://lab.example"))) == HEADINGS["consent"]
