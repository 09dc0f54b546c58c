"""Recordings in an S3-compatible store: asked over HTTP, as browsers and the application do."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest

from app.services.context import AppContext
from app.services.recordings.recordings import FILE, FoundSource
from app.services.recordings.stores import s3_client
from app.services.recordings.stores.s3 import LINK_S
from app.services.runtime.errors import NotFoundError, StoreAwayError
from app.services.studies import lifecycle, repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock
from tests.s3_server import BUCKET, SECRET, S3Server

from .client import Api
from .own_store import begin_anew, folder, own_study, running, settings, store
from .own_study import frames

__all__ = ["folder", "own_study", "running", "settings", "store"]


@pytest.fixture
def url(client: Api, own_study: StudyInfo) -> str:
    """Address of a video that an evaluator is shown."""
    return str(client.start("kettles").to_first_query().state["query"]["left"]["url"])


def link_of(client: Api, url: str, method: str = "GET") -> str:
    answer = client.request(method, url)
    assert answer.status_code == 307, answer.text
    return answer.headers["location"]


def test_a_study_is_kept_in_the_store_and_walks_to_its_end(
    client: Api, own_study: StudyInfo, app: AppContext, folder: Path, store: S3Server, clock: Clock
) -> None:
    own = sorted(frames(video) for video in (folder / "videos").iterdir())
    videos = {store.read(key) for key in store.names()}
    assert sorted(map(frames, videos)) == own
    assert all(re.fullmatch(r"lab/one/uploads/[0-9a-f]{64}\.mp4", key) for key in store.names())
    assert not app.settings.uploads_dir.exists()

    session = client.start("kettles")
    shown: set[str] = set()

    def look_and_choose(state: dict[str, object]) -> str:
        query = state["query"]
        assert isinstance(query, dict)
        shown.update((query["left"]["url"], query["right"]["url"]))
        return "left"

    session.to_the_end(look_and_choose, clock.forward)
    assert session.state["stage"] == "completed"
    assert {httpx.get(link_of(client, url)).content for url in shown} <= videos


def test_a_link_gives_a_video_or_a_part_of_it(client: Api, url: str) -> None:
    link = link_of(client, url)
    whole = httpx.get(link)
    assert (whole.status_code, whole.headers["content-type"]) == (200, "video/mp4")
    assert whole.headers["cache-control"].startswith("private")
    part = httpx.get(link, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, whole.content[100:200])
    head = httpx.head(link_of(client, url, "HEAD"))
    assert (head.status_code, int(head.headers["content-length"])) == (200, len(whole.content))


def test_a_link_is_good_for_minutes_and_a_browser_is_sent_there_for_less(
    client: Api, url: str, store: S3Server
) -> None:
    answer = client.get(url)
    link = answer.headers["location"]
    kept = re.fullmatch(r"private, max-age=(\d+)", answer.headers["cache-control"])
    assert kept
    assert 0 < int(kept[1]) <= LINK_S / 2
    store.forward(LINK_S / 2)
    assert httpx.get(link).status_code == 200
    store.forward(LINK_S / 2)
    assert httpx.get(link).status_code == 403


def test_a_link_is_for_one_video_and_names_nobody(client: Api, url: str, store: S3Server) -> None:
    link = httpx.URL(link_of(client, url))
    assert re.fullmatch(rf"/{BUCKET}/lab/one/uploads/[0-9a-f]{{64}}\.mp4", link.path)
    assert SECRET not in str(link)
    other = next(key for key in store.names() if not link.path.endswith(key))
    assert httpx.get(link.copy_with(path=f"/{BUCKET}/{other}")).status_code == 403
    assert httpx.get(link.copy_with(query=None)).status_code == 403
    assert httpx.delete(link).status_code == 403


def test_a_video_is_looked_up_once_however_often_it_is_asked_for(
    client: Api, url: str, app: AppContext, store: S3Server
) -> None:
    store.asked.clear()
    link_of(client, url)
    assert store.asked == []  # this very process has put it there
    begin_anew(app)
    (link,) = {link_of(client, url) for _ in range(3)}
    assert store.asked == [f"HEAD {httpx.URL(link).path}"]


def test_pages_may_load_videos_from_the_store_and_nothing_else(
    client: Api, own_study: StudyInfo, store: S3Server
) -> None:
    policy = client.get("/s/kettles").headers["content-security-policy"]
    words = dict(part.split(" ", 1) for part in policy.split("; "))
    assert {name for name, allowed in words.items() if store.url in allowed.split()} == {
        "media-src",
        "connect-src",
    }


def test_a_video_that_has_gone_from_the_store_is_not_found(
    client: Api, own_study: StudyInfo, app: AppContext, store: S3Server
) -> None:
    gone = FoundSource(FILE, f"{'0' * 64}.mp4")
    assert app.recordings.is_available(gone)
    with pytest.raises(NotFoundError, match="missing"):
        app.recordings.ensure(gone)
    assert not app.recordings.is_available(gone)


def test_while_the_store_is_away_everybody_is_told_and_nothing_is_lost(
    client: Api,
    own_study: StudyInfo,
    app: AppContext,
    store: S3Server,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It is asked again at once, not only after some seconds.
    monkeypatch.setattr(s3_client, "AWAY_S", 0)
    begin_anew(app)
    session = client.start("kettles").to_first_query()
    url = session.state["query"]["left"]["url"]
    store.stop()
    try:
        refusal = client.get(url)
        assert refusal.status_code == 503
        assert refusal.headers["content-type"] == "application/problem+json"
        assert refusal.json()["detail"] == "the store of recordings cannot be reached"
        assert client.get("/readyz").json()["faults"] == [
            "The store of recordings cannot be reached."
        ]
        repository.close_study(app, "kettles")
        with pytest.raises(StoreAwayError):
            lifecycle.delete(app, "kettles", typed="kettles")
        assert session.respond("left").status_code == 200
    finally:
        store.start()
    assert client.get("/readyz").status_code == 200
    assert httpx.get(link_of(client, url)).status_code == 200
