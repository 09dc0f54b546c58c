"""The studio below a path of a host, behind a proxy that strips the path and one that leaves it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from tests.functional.proxies import Caddy, Proxy

from .conftest import EMAIL, PASSWORD
from .evaluator import answer, enter_small, watch
from .server import Server
from .small_study import SMALL_PLAN
from .test_query_page import responses

ROOT = "/pbpo"


class StrippingCaddy(Caddy):
    """With deploy/caddy/Caddyfile, which strips the path."""

    root = ROOT


class LeavingCaddy(Caddy):
    """Passes requests on as they are, and has something else at the host's own root."""

    root = ROOT

    def command(self, server: str, above: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
        words, environment = super().command(server, above, folder)
        file = folder / "Caddyfile"
        file.write_text(
            f"{self.url} {{\n"
            f"\thandle {ROOT}/* {{\n\t\treverse_proxy {server}\n\t}}\n"
            '\thandle {\n\t\trespond "Something else." 404\n\t}\n}\n'
        )
        words[words.index("--config") + 1] = str(file)
        return words, environment


@pytest.fixture(params=[StrippingCaddy, LeavingCaddy])
def proxy(
    request: pytest.FixtureRequest, serve: Callable[[str], Server], tmp_path: Path
) -> Iterator[tuple[Proxy, Server]]:
    server = serve(SMALL_PLAN)
    server.stop()
    app = open_app(Settings(data_dir=server.data_dir, media_dir=server.media_dir))
    accounts.create(app, EMAIL, PASSWORD)
    app.close()
    server.settings = {"PBPO_ROOT_PATH": ROOT}
    server.start()
    with request.param(server.url, tmp_path, tmp_path / "proxy") as started:
        yield started, server


def test_a_pair_is_answered_and_watched_below_the_path(
    page: Page, proxy: tuple[Proxy, Server]
) -> None:
    started, server = proxy
    asked: list[str] = []
    refused: list[str] = []
    page.on("request", lambda request: asked.append(urlsplit(request.url).path))
    page.on(
        "response",
        lambda response: refused.append(response.url) if response.status >= 400 else None,
    )
    enter_small(page, f"{started.url}{ROOT}/s/small")
    watch(page)
    answer(page, "left", by="key")
    watch(page)
    assert responses(server) == [("left", None)]
    page.get_by_test_id("privacy").click()
    page.get_by_test_id("privacy-back").click()
    watch(page)

    page.goto(f"{started.url}{ROOT}/studies/small")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_test_id("live")).to_contain_text("Live: this page follows")
    page.get_by_role("link", name="Results", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_be_visible()

    # What a script has in memory has an address of its own, of which the path is a whole one.
    assert [path for path in asked if path.startswith("/") and not path.startswith(ROOT)] == []
    assert refused == []
    assert any(path.startswith(f"{ROOT}/media/") for path in asked)
    cookies = page.context.cookies(f"{started.url}{ROOT}/studies")
    assert {cookie["path"] for cookie in cookies} == {ROOT}
    assert page.context.cookies(f"{started.url}/elsewhere") == []
