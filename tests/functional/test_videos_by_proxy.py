"""Videos that the proxy in front sends by itself, through Caddy and nginx as they are shipped."""

from __future__ import annotations

import http.client
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import httpx
import pytest
from sqlalchemy import select

from app.crane import library
from app.services.bootstrap import open_app
from app.services.recordings.recordings import CRANE
from app.services.recordings.stores.factory import OWN_AT_PROXY, RENDERED_AT_PROXY
from app.services.recordings.stores.interface import KEPT
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.storage.models.studies import Recording
from tests.conftest import Idle

from .own_study import write_own_study
from .proxies import Caddy, Nginx, Proxy
from .served import Served

# The server begins before a test has a database of its own, and none of this is about databases.
pytestmark = pytest.mark.sqlite

#: No study can have a file called so.
ODD_NAME = "..%2f..%2fprivate?# é.webm"
TO_PROXY = "X-Accel-Redirect"


@dataclass(frozen=True)
class Behind:
    """What is behind the proxies: a server, and files by what browsers know them as."""

    url: str
    folder: Path
    files: dict[str, Path]
    odd: str

    @property
    def seen(self) -> Path:
        """Above the folder of videos, as the proxies see it."""
        return self.folder / "seen"


@pytest.fixture(scope="module")
def behind(tmp_path_factory: pytest.TempPathFactory, media_dir: Path) -> Iterator[Behind]:
    folder = tmp_path_factory.mktemp("behind")
    own, rendered = (folder / "srv/videos" / name for name in ("own", "rendered"))
    settings = Settings(data_dir=folder / "data", own_videos_dir=own, media_dir=rendered)
    app = open_app(settings, background=Idle(1))
    repository.create(app, repository.load_folder(str(write_own_study(folder / "kettles"))))
    assert not settings.uploads_dir.exists()
    video = Path(shutil.copy(library.ensure_video("env1", 0, 0, media_dir), rendered))
    with app.database.write() as db:
        of_file, of_crane, odd, _ = db.scalars(select(Recording)).all()
        (own / odd.locator).rename(own / ODD_NAME)
        odd.locator = ODD_NAME
        of_crane.source, of_crane.locator = CRANE, "env1/0/0"
        files = {of_file: own / of_file.locator, of_crane: video, odd: own / ODD_NAME}
        named = {recording.public_id: file for recording, file in files.items()}
        behind = Behind("", folder, named, odd.public_id)
    app.close()
    behind.seen.symlink_to(folder / "srv")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PBPO_PROXY_SENDS_VIDEOS", "true")
        patch.setenv("PBPO_OWN_VIDEOS_DIR", str(own))
        with Served("serve", settings.data_dir, rendered) as server:
            yield replace(behind, url=server.url)


@pytest.fixture(scope="module")
def browser() -> Iterator[httpx.Client]:
    with httpx.Client() as client:
        yield client


@pytest.fixture(scope="module", params=[Caddy, Nginx])
def proxy(request: pytest.FixtureRequest, behind: Behind) -> Iterator[Proxy]:
    begun: Proxy = request.param(behind.url, behind.seen, behind.folder / request.param.__name__)
    with begun:
        yield begun


def test_the_server_says_where_a_video_is_and_sends_none(
    behind: Behind, browser: httpx.Client
) -> None:
    for video, file in behind.files.items():
        answer = browser.get(f"{behind.url}/media/{video}.mp4")
        assert answer.status_code == 200
        if video == behind.odd:
            assert TO_PROXY not in answer.headers
            assert answer.content == file.read_bytes()
        else:
            kind = OWN_AT_PROXY if file.parent.name == "own" else RENDERED_AT_PROXY
            assert answer.headers[TO_PROXY] == f"{kind}/{file.name}"
            assert answer.content == b""
    assert browser.get(f"{behind.url}/media/unknown.mp4").status_code == 404


def test_the_proxy_sends_each_video_as_the_server_would(
    behind: Behind, proxy: Proxy, browser: httpx.Client
) -> None:
    for video, file in behind.files.items():
        said = browser.get(f"{behind.url}/media/{video}.mp4").headers
        whole = browser.get(f"{proxy.url}/media/{video}.mp4")
        assert (whole.status_code, whole.content) == (200, file.read_bytes())
        assert TO_PROXY not in whole.headers
        part = browser.get(f"{proxy.url}/media/{video}.mp4", headers={"Range": "bytes=1-9"})
        assert part.status_code == 206
        for answer in (said, whole.headers, part.headers):
            assert "last-modified" not in answer
        assert whole.headers["accept-ranges"] == "bytes"
        assert whole.headers["etag"] == f'"{video}"'
        assert whole.headers["cache-control"] == KEPT
        assert whole.headers["content-type"] == (
            "video/webm" if video == behind.odd else "video/mp4"
        )
        expected = {name for name in said if name not in ("date", "server", TO_PROXY.lower())}
        assert {"x-content-type-options", "content-security-policy"} < expected <= {*whole.headers}
        for name in expected - {"content-length", "x-request-id"}:
            assert whole.headers.get_list(name) == [said[name]], name


def test_the_proxy_sends_parts_and_nothing_to_whom_has_it(
    behind: Behind, proxy: Proxy, browser: httpx.Client
) -> None:
    for video, file in behind.files.items():
        url, size = f"{proxy.url}/media/{video}.mp4", file.stat().st_size
        for condition in ({}, {"If-Range": f'"{video}"'}):
            part = browser.get(url, headers={"Range": "bytes=100-199", **condition})
            assert (part.status_code, part.content) == (206, file.read_bytes()[100:200])
            assert part.headers["content-range"] == f"bytes 100-199/{size}"
        beyond = browser.get(url, headers={"Range": f"bytes={size}-"})
        assert (beyond.status_code, beyond.headers["content-range"]) == (416, f"bytes */{size}")
        kept = browser.get(url, headers={"If-None-Match": f'"{video}"'})
        assert (kept.status_code, kept.content, kept.headers["cache-control"]) == (304, b"", KEPT)
        head = browser.head(url)
        assert (head.status_code, int(head.headers["content-length"])) == (200, size)


def test_nobody_gets_a_file_by_asking_the_proxy_for_it(
    behind: Behind, proxy: Proxy, browser: httpx.Client
) -> None:
    own = next(iter(behind.files.values()))
    (behind.folder / "srv/private").write_text("an answer")
    host, port = httpx.URL(proxy.url).host, httpx.URL(proxy.url).port
    for path in (
        f"/videos/own/{own.name}",
        "/videos/own/",
        "/videos/../private",
        "/media/../videos/own/" + own.name,
        "/media/..%2f..%2fprivate",
        "/videos/own/..%2f..%2fprivate",
        "/private",
        "/data/pbpo.sqlite3",
    ):
        # Sent as it is: httpx would take the dots out.
        connection = http.client.HTTPConnection(host, port)
        connection.request("GET", path, headers={TO_PROXY: f"/videos/own/{own.name}"})
        answer = connection.getresponse()
        assert answer.status in (400, 404), path
        assert b"an answer" not in answer.read()
        connection.close()


def test_a_video_that_the_proxy_cannot_read_is_not_kept_as_missing(
    behind: Behind, proxy: Proxy, browser: httpx.Client
) -> None:
    url = f"{proxy.url}/media/{next(iter(behind.files))}.mp4"
    behind.seen.unlink()
    try:
        missing = browser.get(url)
    finally:
        behind.seen.symlink_to(behind.folder / "srv")
    assert missing.status_code == 404
    assert "no-store" in missing.headers["cache-control"]
    assert browser.get(url).status_code == 200
