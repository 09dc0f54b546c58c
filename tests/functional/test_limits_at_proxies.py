"""The limits of bodies at Caddy and nginx as they are shipped: the app's own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest

from app.web.http.body_limit import LIMITS, SMALL, TEXTS, WITH_EVENTS, limit_of

from .proxies import Caddy, Nginx, Proxy

pytestmark = pytest.mark.sqlite

#: A path under each line of the table, and some under none.
PATHS = {
    "/drafts": None,
    "/drafts/abc/files": None,
    "/drafts/abc/text": TEXTS,
    "/drafts/abc/settings": TEXTS,
    "/studies/short/texts": TEXTS,
    "/api/v1/session/responses": WITH_EVENTS,
    "/api/v1/session/faults": WITH_EVENTS,
    "/api/v1/studies/short/rollouts/abc/recording": None,
    "/api/v1/studies/short/rollouts/abc/measurements": WITH_EVENTS,
    "/api/v1/studies/short/rollouts/abc/failed": SMALL,
    "/api/v1/studies/short/rollouts/claim": SMALL,
    "/sign-in": SMALL,
    "/s/short/consent": SMALL,
    "/api/v1/studies/short/sessions": SMALL,
    "/drafts/abc/text/more": SMALL,
    "/drafts/a/b/files": SMALL,
    "/x/drafts": SMALL,
}


class _Reader(BaseHTTPRequestHandler):
    """Reads every body to its end, and says how long it was."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self._say(0)

    def do_POST(self) -> None:
        left = int(self.headers.get("Content-Length", "0"))
        came = 0
        if self.headers.get("Transfer-Encoding") == "chunked":
            while size := int(self.rfile.readline(), 16):
                came += len(self.rfile.read(size))
                self.rfile.readline()
            self.rfile.readline()
        else:
            came = len(self.rfile.read(left))
        self._say(came)

    def _say(self, came: int) -> None:
        body = str(came).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """A proxy breaks off what is too long."""


@pytest.fixture(scope="module")
def reader() -> Iterator[str]:
    with _Server(("127.0.0.1", 0), _Reader) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module", params=[Caddy, Nginx])
def proxy(
    request: pytest.FixtureRequest, reader: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Proxy]:
    folder: Path = tmp_path_factory.mktemp("limits")
    with request.param(reader, folder, folder / "proxy") as started:
        yield started


def test_the_paths_cover_the_table() -> None:
    assert {path: limit_of(path) for path in PATHS} == PATHS
    assert {limit for _, limit in LIMITS} | {SMALL} == set(PATHS.values())


@pytest.mark.parametrize("path", PATHS)
def test_a_proxy_refuses_what_the_app_would_refuse(proxy: Proxy, path: str) -> None:
    limit = PATHS[path]
    fits = limit if limit is not None else TEXTS + 1
    with httpx.Client(base_url=proxy.url, timeout=30, verify=False) as browser:
        taken = browser.post(path, content=b"a" * fits)
        assert (taken.status_code, taken.text) == (200, str(fits))
        if limit is not None:
            assert browser.post(path, content=b"a" * (limit + 1)).status_code == 413
            said_nothing = iter([b"a" * limit, b"a" * 2])
            assert browser.post(path, content=said_nothing).status_code == 413


def test_nginx_limits_sign_ins_by_address(reader: str, tmp_path: Path) -> None:
    with (
        Nginx(reader, tmp_path, tmp_path / "proxy") as nginx,
        httpx.Client(base_url=nginx.url) as browser,
    ):
        statuses = [browser.post("/sign-in", content=b"x").status_code for _ in range(40)]
        assert statuses[:20] == [200] * 20
        assert 429 in statuses[20:]
        assert browser.get("/sign-in").status_code == 200
        assert browser.post("/s/short/consent", content=b"x").status_code == 200
