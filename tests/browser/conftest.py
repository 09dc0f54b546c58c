"""A real Chromium against a real server with real videos."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Playwright, expect, sync_playwright

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import SHORT_PLAN, write_study

from .forked import ForkedServer
from .server import Server
from .small_study import write_small_study

EMAIL = "ada@lab.example"
PASSWORD = "correct horse battery"

#: Two queries per trial and a break of two seconds: a whole session in under a minute.
BROWSER_PLAN = SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 2").replace(
    "break_s: 120", "break_s: 2"
)

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def chromium() -> str:
    """The browser on this machine; a machine without one fails, and is told what it lacks."""
    named = os.environ.get("PBPO_TEST_CHROMIUM")
    names = [named] if named else ["chromium", "chromium-browser", "google-chrome"]
    for name in names:
        if (path := shutil.which(name)) is not None:
            return path
    raise FileNotFoundError(
        f"expected one of {', '.join(names)} on the PATH (Debian: apt-get install chromium), "
        "or its place in PBPO_TEST_CHROMIUM"
    )


#: A busy machine is no fault of the page: what is waited for comes, or it does not.
PATIENCE_MS = 30_000
expect.set_options(timeout=PATIENCE_MS)


@pytest.fixture(scope="package")
def playwright() -> Iterator[Playwright]:
    with sync_playwright() as playwright:
        yield playwright


@pytest.fixture(scope="package")
def browser(playwright: Playwright) -> Iterator[Browser]:
    browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
    yield browser
    browser.close()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(PATIENCE_MS)
    yield context
    context.close()


@pytest.fixture
def page(context: BrowserContext) -> Page:
    return context.new_page()


@pytest.fixture
def server(tmp_path: Path, media_dir: Path) -> Iterator[Server]:
    """A server with one open study and one experimenter."""
    data_dir = tmp_path / "data"
    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir))
    repository.create(
        app, repository.load_folder(str(write_study(tmp_path / "study", BROWSER_PLAN)))
    )
    repository.open_study(app, "short")
    accounts.create(app, EMAIL, PASSWORD)
    app.close()
    server = ForkedServer(data_dir, media_dir)
    server.start()
    yield server
    server.kill()


def serving(place: Path, media_dir: Path, plan: str, **more: Any) -> Server:
    """A server that has started, with one open study of small videos; its data are in `place`."""
    data_dir = place / "data"
    app = open_app(Settings(data_dir=data_dir, media_dir=media_dir))
    folder = repository.load_folder(str(write_small_study(place / "study", plan, **more)))
    repository.create(app, folder)
    repository.open_study(app, folder.plan.slug)
    app.close()
    server = ForkedServer(data_dir, media_dir)
    server.start()
    return server


@pytest.fixture
def serve(tmp_path: Path, media_dir: Path) -> Iterator[Callable[..., Server]]:
    """Starts a server with one open study of small videos under the plan that it is given.

    The same words as of `write_small_study` may follow.
    """
    servers: list[Server] = []

    def start(plan: str, **more: Any) -> Server:
        servers.append(serving(tmp_path, media_dir, plan, **more))
        return servers[-1]

    yield start
    for server in servers:
        server.kill()
