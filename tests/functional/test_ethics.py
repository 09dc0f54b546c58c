"""What an ethics board is shown: a page, and a zip with everything, alike each time."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import zipfile
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from PIL import Image

from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Role
from app.services.background.interface import Background
from app.services.context import AppContext
from app.services.ethics import bundle, bundle_job, column_purposes, screenshots
from app.services.ethics.page_states import screens
from app.services.runtime.settings import Settings
from app.services.sessions.state_view import State
from app.services.studies import repository, revision
from app.storage.models.studies import Base
from tests.conftest import Clock

from .client import Api
from .conftest import EMAIL, PASSWORD, Recruit
from .own_study import write_own_study
from .test_experimenter_pages import sign_in
from .test_jobs import AtOnce, Never
from .test_leaving import rows_of_people
from .test_secrecy import telling, walk

FULL = """
device_check: {min_width_px: 300}
practice: {queries: 1}
retention: {identity_days: 30, everything_days: 365}
recruitment: {platform: prolific, codes: {completed: C1AB2CDE}}
questionnaires:
  after_trial: [{name: effort, type: likert, label: "How hard was it?"}]
  end: [{name: age, type: number, label: "How old are you?"}]
"""
REVIEWER = "rev@board.example"


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """No browser: pictures take seconds, and have a test of their own."""
    return settings.model_copy(update={"chromium": "no-such-browser"})


@pytest.fixture
def reviewer(client: Api, app: AppContext, recruit: Recruit) -> Api:
    recruit(FULL)
    accounts.create(app, EMAIL, PASSWORD)
    accounts.create(app, REVIEWER, PASSWORD, Role.REVIEWER)
    assert sign_in(client, REVIEWER).status_code == 303
    return client


@pytest.fixture
def background() -> Background:
    return AtOnce(1)


def ask(api: Api, slug: str = "short") -> None:
    """Ask for the bundle by the form of its page."""
    page = api.get(f"/studies/{slug}/ethics").text
    found = re.search(r'name="csrf_token" value="([0-9a-f]+)"', page)
    assert found, page
    answer = api.post(f"/studies/{slug}/ethics/bundle", data={"csrf_token": found[1]})
    assert answer.status_code == 303, answer.text


def made(api: Api, slug: str = "short") -> httpx.Response:
    """Ask for the bundle, and download it."""
    ask(api, slug)
    answer = api.get(f"/studies/{slug}/ethics.zip")
    assert answer.status_code == 200, answer.text
    return answer


def opened(answer: httpx.Response) -> zipfile.ZipFile:
    return zipfile.ZipFile(io.BytesIO(answer.content))


def test_every_stored_column_has_a_purpose() -> None:
    stored = {
        table.name: {column.name for column in table.columns}
        for table in Base.metadata.sorted_tables
    }
    told = {name: set(table.purposes) for name, table in column_purposes.STORED.items()}
    assert stored == told, "say in app/services/ethics/column_purposes.py what a new column is for"
    for table in column_purposes.STORED.values():
        assert all(purpose.endswith(".") for purpose in table.purposes.values())


def test_a_reviewer_reads_what_is_kept_for_how_long_and_by_whom(reviewer: Api) -> None:
    page = reviewer.get("/studies/short/ethics").text
    assert "30 days after a session has ended" in page
    assert "365 days after a session has ended" in page
    for name in ("participants", "identities", "responses", "audit events"):
        assert f"{name.capitalize()}: about" in page
    assert "/studies/short/ethics/bundle" in page


def test_the_bundle_holds_texts_screens_fields_and_plan(
    reviewer: Api, app: AppContext, client: Api
) -> None:
    bundle = opened(made(reviewer))
    names = bundle.namelist()
    consent = bundle.read("texts/version-1/en/consent.md")
    said = json.loads(bundle.read("versions.json"))
    (told,) = [text for text in said["texts"] if text["text"] == "consent"]
    assert told["sha256"] == hashlib.sha256(consent).hexdigest()
    assert told["consent_version"] == client.start().state["consent"]["version"]
    assert json.loads(bundle.read("plan.json"))["retention"]["everything_days"] == 365
    rows = list(csv.DictReader(io.StringIO(bundle.read("stored_fields.csv").decode())))
    assert len(rows) == sum(len(table.columns) for table in Base.metadata.sorted_tables)
    assert all(all(row.values()) for row in rows)
    (kept,) = {row["kept"] for row in rows if row["table"] == "identities"}
    assert kept.startswith("30 days after the session has ended")
    assert [
        re.sub(r"^screens/en/\d\d-|\.html$", "", name) for name in names if "screens" in name
    ] == [
        *("consent", "device-check", "instructions", "familiarisation", "practice"),
        *("comparison-1", "stop", "comparison-2", "comparison-3", "questions-after-a-part"),
        *("break", "questions-at-the-end", "debrief", "completed", "screened-out"),
        *("stopped", "declined", "privacy", "delete"),
    ]
    assert audit_log.trail(app, "short")[0].action == "ethics bundle asked for"


def test_screens_stand_for_themselves_and_tell_nothing(reviewer: Api) -> None:
    bundle = opened(made(reviewer))
    for name in bundle.namelist():
        if not name.startswith("screens/"):
            continue
        page = bundle.read(name).decode()
        assert "<style>" in page
        assert "<script" not in page
        assert "<link" not in page
        assert "<video" not in page
        words = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
        # A picture's letters may spell anything.
        words = re.sub(r'src="data:[^"]*"', "", words).replace('method="post"', "")
        assert telling(words) == [], name
    said = bundle.read("screens/en/14-completed.html").decode()
    assert "C1AB2CDE" in said
    assert re.search(r'data-testid="receipt">[2-9A-Z-]{19}<', said)


def test_the_screens_show_what_a_person_is_shown(
    reviewer: Api, app: AppContext, clock: Clock
) -> None:
    """Each state of the bundle has the keys that the same stage of a real session has."""
    made_up: dict[str, State] = {}
    for screen in screens(app, repository.find(app, "short"), "en"):
        made_up.setdefault(screen.state["stage"], screen.state)
    session = reviewer.start(external_ids={"PROLIFIC_PID": "x"})
    seen: dict[str, State] = {}
    while session.state["stage"] != "completed":
        seen.setdefault(session.state["stage"], session.state)
        session.step("left", clock.forward)
    seen["completed"] = session.state
    for stage, state in seen.items():
        assert keys(state) == keys(made_up[stage]), stage


def keys(state: State) -> set[str]:
    """But for those of the skip button: which condition comes first is drawn for each person."""
    every = {path for path, _, _ in walk(state)} - {"/query/practice"}
    return {path for path in every if "skip/" not in path}


def test_the_same_study_gives_the_same_bytes_and_leaves_nobody(
    reviewer: Api, app: AppContext
) -> None:
    first = made(reviewer).content
    assert made(reviewer).content == first
    people = ("participants", "sessions", "trials", "queries", "identities")
    assert not rows_of_people(app).keys() & set(people)


def test_a_bundle_is_downloaded_once_it_was_made_by_whoever_may_see_the_design(
    reviewer: Api, app: AppContext
) -> None:
    before = reviewer.get("/studies/short/ethics")
    assert "ethics.zip" not in before.text
    assert reviewer.get("/studies/short/ethics.zip").status_code == 404
    answer = made(reviewer)
    assert answer.headers["content-type"] == "application/zip"
    assert 'filename="short-ethics.zip"' in answer.headers["content-disposition"]
    assert answer.headers["cache-control"] == "no-store"
    assert "The last bundle was made" in reviewer.get("/studies/short/ethics").text
    # What was laid ready for the job is gone with it.
    folder = bundle_job.folder(app.settings)
    study_id = repository.find(app, "short").id
    assert [path.name for path in folder.iterdir()] == [f"{study_id}.zip"]
    # It was another one's job: its progress is theirs, the bundle is everybody's who may.
    assert sign_in(reviewer, EMAIL).status_code == 303
    assert reviewer.get("/studies/short/ethics.zip").content == answer.content


def test_a_bundle_that_fails_is_told_and_the_former_one_stays(
    reviewer: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    former = made(reviewer).content
    with monkeypatch.context() as patch:
        patch.setattr(screenshots, "picture_of", None)
        ask(reviewer)
    page = reviewer.get("/studies/short/ethics").text
    assert "The bundle could not be made" in page
    assert reviewer.get("/studies/short/ethics.zip").content == former


def test_a_job_that_is_begun_again_at_its_very_end_leaves_the_bundle(
    reviewer: Api, app: AppContext
) -> None:
    former = made(reviewer).content
    study_id = repository.find(app, "short").id
    asked = {"laid": "gone-1", "study_id": study_id}
    bundle_job.make_bundle(app.settings, asked, lambda *_: None)
    assert reviewer.get("/studies/short/ethics.zip").content == former


def test_bundles_of_studies_that_are_gone_and_what_was_laid_ready_in_vain_are_removed(
    reviewer: Api, app: AppContext, clock: Clock
) -> None:
    made(reviewer)
    folder = bundle_job.folder(app.settings)
    study_id = repository.find(app, "short").id
    (folder / f"{study_id + 1}.zip").write_bytes(b"of a study that is gone")
    laid = bundle_job.stage_files(app.settings, {"plan.json": b"{}"}, 1)
    assert bundle.delete_leftovers(app) == 1
    long_ago = (clock.now() - timedelta(days=8)).timestamp()
    os.utime(folder / laid, (long_ago, long_ago))
    assert bundle.delete_leftovers(app) == 1
    assert [path.name for path in folder.iterdir()] == [f"{study_id}.zip"]


class TestWhileItIsMade:
    @pytest.fixture
    def background(self) -> Background:
        return Never(1)

    def test_its_page_shows_how_far_it_is_to_whoever_asked(
        self, reviewer: Api, app: AppContext
    ) -> None:
        ask(reviewer)
        page = reviewer.get("/studies/short/ethics").text
        assert 'data-state="waiting"' in page
        # One is enough.
        assert "/ethics/bundle" not in page
        assert sign_in(reviewer, EMAIL).status_code == 303
        assert 'data-testid="job"' not in reviewer.get("/studies/short/ethics").text


def test_texts_of_every_version_and_language_are_in_it(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    repository.create(app, repository.load_folder(str(folder)))
    (folder / "texts" / "en" / "consent.md").write_text("Another consent.\n")
    revision.revise(app, repository.load_folder(str(folder)))
    accounts.create(app, EMAIL, PASSWORD)
    sign_in(client)
    bundle = opened(made(client, "kettles"))
    for version in (1, 2):
        for language in ("en", "ja"):
            assert f"texts/version-{version}/{language}/debrief.md" in bundle.namelist()
    assert bundle.read("texts/version-2/en/consent.md") == b"Another consent.\n"
    # A study's own videos are there: stills of them stand in the pictures.
    page = bundle.read("screens/ja/03-comparison-1.html").decode()
    assert page.count('src="data:image/jpeg;base64,') == 2
    assert "どちらも" in page
    # As a page looks whose videos play: its buttons can be pressed, as the styles know them.
    assert 'data-testid="answer-left" data-once aria-disabled="false"' in page
    assert '[aria-disabled="true"]' in page
    assert 'lang="ja"' in page


class TestWithABrowser:
    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return settings.model_copy(update={"chromium": ""})

    def test_a_page_becomes_a_picture_once(
        self, app: AppContext, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert screenshots.browser(app.settings) is not None, (
            "expected a Chromium (apt install chromium)"
        )
        html = (
            "<!doctype html><style>body { margin: 0; background: #fff }"
            " p { height: 900px; margin: 0; background: #123456 }</style><p>"
        )
        taken = screenshots.picture_of(app.settings, html)
        assert taken is not None
        with Image.open(io.BytesIO(taken)) as picture:
            assert picture.size == (1280, 932)
            assert picture.getpixel((640, 450)) == (0x12, 0x34, 0x56)
            assert picture.getpixel((640, 931)) == (255, 255, 255)
        monkeypatch.setattr(screenshots, "_take", None)
        assert screenshots.picture_of(app.settings, html) == taken

    def test_a_browser_that_fails_leaves_the_pages(
        self, app: AppContext, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(screenshots, "browser", lambda _: "/bin/false")
        assert screenshots.picture_of(app.settings, "<p>") is None
