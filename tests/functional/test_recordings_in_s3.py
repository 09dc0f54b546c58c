"""Recordings in an S3-compatible store: asked over HTTP, as browsers and the application do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.services import cloning, lifecycle, studies
from app.services.errors import ConflictError, NotFoundError, StoreAwayError
from app.services.recordings import FILE, FoundSource, Recordings, crane_locator, make_video
from app.services.settings import Settings
from app.services.stores import s3_bucket
from app.services.stores.opening import open_stores
from app.services.stores.s3 import LINK_S
from app.services.studies import StudyInfo
from app.services.studio import Studio
from tests.conftest import Clock
from tests.s3_server import BUCKET, KEY, SECRET, S3Server

from .client import Api
from .own_study import write_own_study


@pytest.fixture(scope="module")
def running() -> Iterator[S3Server]:
    server = S3Server()
    yield server
    server.stop()


@pytest.fixture
def store(running: S3Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[S3Server]:
    """An empty store, with its keys where boto3 looks for them."""
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", KEY)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    running.asked.clear()
    yield running
    running.empty()


@pytest.fixture
def settings(store: S3Server, tmp_path: Path, media_dir: Path) -> Settings:
    return Settings(
        data_dir=tmp_path / "data",
        media_dir=media_dir,
        recordings_url=f"s3://{BUCKET}/lab/one",
        s3_endpoint=store.url,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_study(tmp_path_factory.mktemp("own") / "kettles")


@pytest.fixture
def own_study(studio: Studio, folder: Path) -> StudyInfo:
    studies.create(studio, studies.load_folder(str(folder)))
    return studies.open_study(studio, "kettles")


@pytest.fixture
def url(client: Api, own_study: StudyInfo) -> str:
    """Address of a video that an evaluator is shown."""
    return str(client.start("kettles").to_first_query().state["query"]["left"]["url"])


def begin_anew(studio: Studio) -> None:
    """As a server does that was just started: nothing of the store is remembered."""
    studio.recordings.close()
    fresh = Recordings(studio.database, studio.background, studio.settings)
    object.__setattr__(studio, "recordings", fresh)


def link_of(client: Api, url: str, method: str = "GET") -> str:
    answer = client.request(method, url)
    assert answer.status_code == 307, answer.text
    return answer.headers["location"]


def test_a_study_is_kept_in_the_store_and_walks_to_its_end(
    client: Api, own_study: StudyInfo, studio: Studio, folder: Path, store: S3Server, clock: Clock
) -> None:
    videos = {video.read_bytes() for video in (folder / "videos").iterdir()}
    assert {store.read(key) for key in store.names()} == videos
    assert all(re.fullmatch(r"lab/one/uploads/[0-9a-f]{64}\.mp4", key) for key in store.names())
    assert not studio.settings.uploads_dir.exists()

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
    client: Api, url: str, studio: Studio, store: S3Server
) -> None:
    store.asked.clear()
    link_of(client, url)
    assert store.asked == []  # this very process has put it there
    begin_anew(studio)
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


def test_a_rendered_video_is_put_into_the_store_by_whoever_made_it(
    studio: Studio, store: S3Server
) -> None:
    locator = crane_locator("env1", 0, 0)
    made = make_video(studio.settings, locator)
    (key,) = store.names()
    # By its content: neither the environment nor the candidate is in the name.
    assert re.fullmatch(r"lab/one/media/[0-9a-f]{32}\.mp4", key)
    assert store.read(key) == made.read_bytes()
    source = FoundSource("crane", locator)
    assert studio.recordings.ensure(source).done()
    assert studio.recordings.sizes([source]) == {locator: made.stat().st_size}


def test_a_video_that_has_gone_from_the_store_is_not_found(
    client: Api, own_study: StudyInfo, studio: Studio, store: S3Server
) -> None:
    gone = FoundSource(FILE, f"{'0' * 64}.mp4")
    assert studio.recordings.can_be_had(gone)
    with pytest.raises(NotFoundError, match="missing"):
        studio.recordings.ensure(gone)
    assert not studio.recordings.can_be_had(gone)


def test_a_copy_of_a_study_has_its_videos(
    studio: Studio, own_study: StudyInfo, folder: Path, tmp_path: Path
) -> None:
    cloning.write_folder(studio, "kettles", tmp_path / "copy", "copied")
    for video in (folder / "videos").iterdir():
        assert (tmp_path / "copy" / "videos" / video.name).read_bytes() == video.read_bytes()


def test_what_is_deleted_goes_from_the_store_and_nothing_beside_it(
    studio: Studio, own_study: StudyInfo, store: S3Server
) -> None:
    name = store.names()[0].rpartition("/")[2]
    beside = [f"lab/{name}", f"lab/one/media/{name}", f"uploads/{name}"]
    for key in beside:
        store.client.put_object(Bucket=BUCKET, Key=key, Body=b"another's")
    studies.close_study(studio, "kettles")
    lifecycle.delete(studio, "kettles", typed="kettles")
    assert sorted(store.names()) == sorted(beside)
    with pytest.raises(ValueError, match="expected the name of a file"):
        studio.recordings.throw_away(["../../uploads/" + name])


def test_while_the_store_is_away_everybody_is_told_and_nothing_is_lost(
    client: Api,
    own_study: StudyInfo,
    studio: Studio,
    store: S3Server,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It is asked again at once, not only after some seconds.
    monkeypatch.setattr(s3_bucket, "AWAY_S", 0)
    begin_anew(studio)
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
        studies.close_study(studio, "kettles")
        with pytest.raises(StoreAwayError):
            lifecycle.delete(studio, "kettles", typed="kettles")
        assert session.respond("left").status_code == 200
    finally:
        store.start()
    assert client.get("/readyz").status_code == 200
    assert httpx.get(link_of(client, url)).status_code == 200


def test_a_store_that_refuses_is_said_without_its_keys(
    client: Api, studio: Studio, store: S3Server, settings: Settings
) -> None:
    elsewhere = settings.model_copy(update={"recordings_url": "s3://another-bucket"})
    object.__setattr__(studio, "settings", elsewhere)
    begin_anew(studio)
    (fault,) = client.get("/readyz").json()["faults"]
    assert fault == "The store of recordings refuses: NoSuchBucket."


def test_without_keys_a_studio_is_not_opened(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    with pytest.raises(ConflictError, match="expected credentials"):
        open_stores(settings)
