"""Videos that a browser gets from an S3-compatible store: another site than ours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.s3_server import BUCKET, KEY, SECRET, S3Server

from .evaluator import answer, enter_small, watch
from .forked import ForkedServer
from .server import Server
from .small_study import SMALL_PLAN, write_small_study

#: Pairs at random: whatever is answered, one pair comes next, and that one is preloaded.
PLAN = SMALL_PLAN.replace(
    "like either.}", "like either.}\n    settings: {preset: paper-env1, random_queries: 3}"
)

#: Scripts have fetched both videos of another pair, whole.
PRELOADED = """() => performance.getEntriesByType("resource").filter(
    (entry) => entry.initiatorType === "fetch" && entry.name.includes("/media/")
        && entry.responseEnd > 0).length >= 2"""

SOURCES = """() => ["video-left", "video-right"].map(
    (name) => document.querySelector(`[data-testid="${name}"]`).currentSrc)"""


@pytest.fixture(scope="module")
def store() -> Iterator[S3Server]:
    server = S3Server()
    yield server
    server.stop()


@pytest.fixture(scope="module")
def server(
    store: S3Server, tmp_path_factory: pytest.TempPathFactory, media_dir: Path
) -> Iterator[Server]:
    """A server whose videos are in the store."""
    folder = tmp_path_factory.mktemp("store")
    where = {"PBPO_RECORDINGS_URL": f"s3://{BUCKET}/lab", "PBPO_S3_ENDPOINT": store.url}
    keys = {"AWS_ACCESS_KEY_ID": KEY, "AWS_SECRET_ACCESS_KEY": SECRET}
    server = ForkedServer(folder / "data", media_dir, settings={**where, **keys})
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {**where, **keys}.items():
            patch.setenv(name, value)
        app = open_app(Settings(data_dir=server.data_dir, media_dir=media_dir))
        study = repository.load_folder(str(write_small_study(folder / "study", PLAN)))
        repository.create(app, study)
        repository.open_study(app, "small")
        app.close()
    server.start()
    yield server
    server.kill()


def test_pairs_are_preloaded_from_the_store_and_played(
    page: Page, server: Server, store: S3Server
) -> None:
    store.let_read(server.url)
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    enter_small(page, f"{server.url}/s/small")
    page.wait_for_function(PRELOADED)
    assert complaints == []
    answer(page, "left", by="key")
    watch(page)
    assert all(source.startswith("blob:") for source in page.evaluate(SOURCES))


def test_videos_play_by_their_addresses_once_the_store_is_back_if_no_script_may_read_them(
    page: Page, server: Server, store: S3Server
) -> None:
    store.let_read("https://elsewhere.example")
    store.stop()
    try:
        page.goto(f"{server.url}/s/small")
        page.get_by_test_id("consent").click()
        page.get_by_test_id("continue").click()
        expect(page.get_by_text("This video did not load.").first).to_be_visible()
    finally:
        store.start()
    watch(page)
    assert all("/media/" in source for source in page.evaluate(SOURCES))
