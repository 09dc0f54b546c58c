"""Addresses and headers of videos tell nothing of candidates, nor of other sessions."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest

from app.services.context import AppContext
from app.services.sessions import withdrawal
from app.services.studies.repository import StudyInfo

from .client import Api, Session
from .own_study import folder, own_study

__all__ = ["folder", "own_study"]


def shown(app: AppContext, session: Session) -> dict[str, int]:
    """The addresses that a session knows at its present query, and what they stand for."""
    query = session.state["query"]
    found = {}
    for url in (query["left"]["url"], query["right"]["url"], *query["prefetch"]):
        opened = app.addresses.opened(PurePosixPath(url).stem)
        assert opened is not None
        found[url] = opened.recording_id
    return found


def test_no_two_sessions_and_no_two_pairs_share_an_address(
    client: Api, app: AppContext, own_study: StudyInfo
) -> None:
    """The study has four recordings: each comes several times."""
    addresses: list[str] = []
    recordings: list[int] = []
    for _ in range(2):
        session = client.start("kettles").to_first_query()
        while session.state["stage"] == "query" and session.state["progress"]["trial"] == 1:
            query = session.state["query"]
            pair = {query[side]["url"] for side in ("left", "right")}
            known = shown(app, session)
            addresses += pair
            recordings += [known[url] for url in pair]
            session.respond("left")
    assert len(recordings) > len(set(recordings)) * 2
    assert len(set(addresses)) == len(addresses)


def test_an_address_stays_the_same_while_its_pair_is_shown(
    client: Api, own_study: StudyInfo
) -> None:
    session = client.start("kettles").to_first_query()
    before = session.state["query"]
    assert session.look()["query"]["left"] == before["left"]
    answer = client.get(before["left"]["url"])
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["etag"] == f'"{PurePosixPath(before["left"]["url"]).stem}"'


@pytest.mark.parametrize("where", ["here", "in another process"])
def test_addresses_of_a_deleted_session_lead_nowhere(
    client: Api, app: AppContext, own_study: StudyInfo, where: str
) -> None:
    session = client.start("kettles").to_first_query()
    url = session.state["query"]["left"]["url"]
    if where == "here":
        assert client.get(url).status_code == 200
    withdrawal.withdraw_and_delete(app, session.token)
    assert client.get(url).status_code == 410
    # The next session has the row's number again: it is another session all the same.
    client.start("kettles").to_first_query()
    assert client.get(url).status_code == 410


def test_an_address_that_was_made_up_leads_nowhere(client: Api, own_study: StudyInfo) -> None:
    url = client.start("kettles").to_first_query().state["query"]["left"]["url"]
    name = PurePosixPath(url).stem
    other = "A" if name[10] != "A" else "B"
    assert client.get(f"/media/{name[:10]}{other}{name[11:]}.mp4").status_code == 404


ASKED: list[tuple[str, dict[str, str]]] = [
    ("GET", {}),
    ("HEAD", {}),
    ("GET", {"Range": "bytes=0-"}),
    ("GET", {"Range": "bytes=10-99"}),
    ("GET", {"Range": "bytes=0-9,20-29"}),
    ("HEAD", {"Range": "bytes=10-99"}),
    ("GET", {"Range": "bytes=10-99", "If-Range": "Mon, 01 Jan 2029 00:00:00 GMT"}),
    ("GET", {"Range": "bytes=999999999-"}),
    ("GET", {"If-None-Match": "THE"}),
    ("GET", {"If-Modified-Since": "Mon, 01 Jan 2029 00:00:00 GMT"}),
]


@pytest.mark.parametrize(("method", "headers"), ASKED)
def test_no_answer_tells_when_a_video_was_made(
    client: Api, own_study: StudyInfo, method: str, headers: dict[str, str]
) -> None:
    url = client.start("kettles").to_first_query().state["query"]["left"]["url"]
    etag = f'"{PurePosixPath(url).stem}"'
    asked = {name: etag if value == "THE" else value for name, value in headers.items()}
    answer = client.request(method, url, headers=asked)
    assert answer.status_code in (200, 206, 304, 416)
    assert "last-modified" not in answer.headers
    assert answer.headers.get("etag", etag) == etag
