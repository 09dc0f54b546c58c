"""Links that each let one person in, once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from sqlalchemy import select
from typer.testing import CliRunner

from app import cli
from app.commands.options import closing_studios
from app.services.accounts import accounts
from app.services.arrival import admission, entry_links
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, EntryLinkError
from app.services.studies.repository import StudyInfo
from app.storage.models.arrivals import EntryLink
from app.storage.models.studies import SessionRow
from tests.conftest import database_file

from .client import Api
from .conftest import EMAIL, PASSWORD, Recruit
from .test_leaving import rows_of_people
from .test_participant_pages import COOKIE, HEADINGS, heading, sent_on, version

SINGLE_USE = "\nrecruitment: {links: single-use}\n"
NEEDED = "This study needs a link of your own"
USED = "This link has been used"


@pytest.fixture
def study(recruit: Recruit) -> StudyInfo:
    return recruit(SINGLE_USE)


def links(app: AppContext, count: int = 1) -> list[str]:
    return entry_links.create(app, "short", count)


def agree_by(client: Api, link: str) -> None:
    page = client.get(link)
    sent_on(client.post(link.replace("?", "/consent?", 1), data={"version": version(page)}))


def test_a_link_lets_one_person_in_and_then_nobody_else(
    client: Api, app: AppContext, study: StudyInfo
) -> None:
    link = links(app)[0]
    assert re.fullmatch(r"/s/short\?entry=[A-Za-z0-9_-]{43}", link)
    # Looking at the consent uses nothing up.
    for _ in range(2):
        assert heading(client.get(link)) == HEADINGS["consent"]
    agree_by(client, link)
    assert heading(client.get("/s/short")) == "What you will do"
    assert heading(client.get(link)) == "What you will do"

    client.cookies.clear()
    second = client.get(link)
    assert (second.status_code, heading(second)) == (403, USED)
    # The session's start has the time of day, and no session can be found by its link.
    with app.database.read() as db:
        used_at = db.scalars(select(EntryLink.used_at)).one()
        started_at = db.scalars(select(SessionRow.started_at)).one()
    midnight = started_at.replace(hour=0, minute=0, second=0, microsecond=0)
    assert used_at == midnight < started_at


@pytest.mark.parametrize("query", ["", "?entry=", "?entry=made-up"])
def test_without_a_link_of_ones_own_the_page_says_so_kindly(
    client: Api, app: AppContext, study: StudyInfo, query: str
) -> None:
    links(app)
    page = client.get(f"/s/short{query}")
    assert (page.status_code, heading(page)) == (403, NEEDED)
    assert "Please open yours" in page.text
    consent = client.post(f"/s/short/consent{query}", data={"version": "0" * 12})
    assert (consent.status_code, heading(consent)) == (403, NEEDED)
    assert rows_of_people(app) == {"entry_links": 1}


def test_declining_uses_no_link(client: Api, app: AppContext, study: StudyInfo) -> None:
    link = links(app)[0]
    client.post(link.replace("?", "/decline?", 1))
    assert entry_links.counts(app, study.id).used == 0


def test_of_two_who_come_at_once_by_one_link_one_is_let_in(
    client: Api, app: AppContext, study: StudyInfo
) -> None:
    link = links(app)[0]
    page = client.get(link)
    given = {"version": version(page)}
    path = link.replace("?", "/consent?", 1)
    sent_on(client.post(path, data=given))
    client.cookies.clear()
    late = client.post(path, data=given)
    assert (late.status_code, heading(late)) == (403, USED)
    assert COOKIE not in client.cookies
    assert rows_of_people(app)["sessions"] == 1


def test_marking_a_link_that_was_just_taken_fails(
    app: AppContext, study: StudyInfo, monkeypatch: pytest.MonkeyPatch
) -> None:
    token = links(app)[0].partition("=")[2]
    admission.start(app, "short", entry=token)
    # As it is for whoever looked before the other one wrote.
    monkeypatch.setattr(entry_links, "require_unused", lambda *_: None)
    with pytest.raises(EntryLinkError, match="nobody has used yet"):
        admission.start(app, "short", entry=token)
    assert rows_of_people(app)["sessions"] == 1


def test_the_api_takes_the_token_of_a_link(client: Api, app: AppContext, study: StudyInfo) -> None:
    token = links(app)[0].partition("=")[2]
    path = "/api/v1/studies/short/sessions"
    refusal = client.post(path, json={})
    assert (refusal.status_code, refusal.json()["type"]) == (
        403,
        "urn:pbpo-studio:problem:entry-link",
    )
    assert client.post(path, json={"entry": token}).status_code == 201
    assert client.post(path, json={"entry": token}).status_code == 403
    assert client.post(path, json={"mode": "preview"}).status_code == 403


@pytest.mark.sqlite
def test_the_token_is_nowhere_in_the_database(
    client: Api, app: AppContext, study: StudyInfo
) -> None:
    link = links(app)[0]
    agree_by(client, link)
    token = link.partition("=")[2].encode()
    file = database_file(app.settings)
    files = [file, file.with_name(f"{file.name}-wal")]
    assert not any(token in path.read_bytes() for path in files if path.exists())


def test_a_study_that_is_open_to_everybody_has_no_such_links(
    client: Api, app: AppContext, short_study: StudyInfo
) -> None:
    with pytest.raises(ConflictError, match="links: single-use"):
        links(app)
    assert heading(client.get("/s/short?entry=any")) == HEADINGS["consent"]


def test_the_command_prints_one_link_on_each_line(
    app: AppContext, study: StudyInfo, tmp_path: Path
) -> None:
    command = ["link", "create", "short", "--count", "3", "--address", "https://lab.example/"]
    with closing_studios():
        run = CliRunner().invoke(cli.commands, [*command, "--data-dir", str(app.settings.data_dir)])
    assert run.exit_code == 0, run.output
    lines = run.output.splitlines()
    assert len(set(lines)) == 3
    assert all(line.startswith("https://lab.example/s/short?entry=") for line in lines)
    assert entry_links.counts(app, study.id) == entry_links.Counts(made=3, used=0)


def test_the_experimenter_sees_how_many_links_were_used(
    client: Api, app: AppContext, study: StudyInfo
) -> None:
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    agree_by(client, links(app, 4)[0])
    page = client.get("/studies/short", headers={"Authorization": f"Bearer {token}"}).text
    assert "1 of 4 have been used" in page
