"""Videos that are recorded while people choose: by a machine that dies, and by hand on a phone."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from playwright.sync_api import Browser, Page, expect

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.rollouts import machines
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import write_study

from .conftest import EMAIL, PASSWORD, PATIENCE_MS
from .evaluator import answer, watch
from .for_everyone import violations
from .forked import ForkedServer
from .server import Server
from .small_study import write_small_study

PAIRS = 10
PLAN = f"""
version: 1
slug: live
title: Live
languages: [en]
parameters:
  - {{name: w0, label: Opening time, unit: s, min: 0, max: 1}}
  - {{name: w1, label: Closing time, unit: s, min: 0, max: 1}}
constraints: [w0 >= w1]
environments:
  pit: {{source: machine, rollout: {{timeout_s: 5, attempts: 1, ahead: 1}}}}
conditions:
  - name: threshold
    method: pbpo-threshold
    environment: pit
    skip: {{label: Neither}}
    settings: {{threshold_covering: 8}}
queries_per_trial: {PAIRS}
break_s: 0
"""
PHONE = {"width": 360, "height": 740}
WAITS = "Your next videos are not recorded yet"
MACHINE = Path(__file__).with_name("recording_machine.py")


class Lab:
    """A server with an open study over ranges, a machine's token, and a video for its runs."""

    def __init__(self, folder: Path, media_dir: Path) -> None:
        self.folder = folder
        app = open_app(Settings(data_dir=folder / "data", media_dir=media_dir))
        write_study(folder / "study", PLAN)
        repository.create(app, repository.load_folder(str(folder / "study")))
        repository.open_study(app, "live")
        accounts.create(app, EMAIL, PASSWORD)
        self._token = machines.add(app, "live", "arm")
        app.close()
        write_small_study(folder / "small", candidates=1)
        (folder / "small" / "videos" / "0-0.mp4").rename(folder / "video.mp4")
        self.server: Server = ForkedServer(folder / "data", media_dir)
        self._machine: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return self.server.url

    def start_machine(self) -> None:
        words = [sys.executable, str(MACHINE), self.url, "live", self._token, str(self.folder)]
        self._machine = subprocess.Popen(words)

    def kill_machine(self) -> None:
        """As a power cut would."""
        if self._machine is not None:
            self._machine.send_signal(signal.SIGKILL)
            self._machine.wait()
            self._machine = None


@pytest.fixture
def lab(tmp_path: Path, media_dir: Path) -> Iterator[Lab]:
    lab = Lab(tmp_path, media_dir)
    lab.server.start()
    yield lab
    lab.kill_machine()
    lab.server.kill()


def enter(page: Page, lab: Lab) -> None:
    """From the link to the first pair, which nothing has recorded yet."""
    page.goto(f"{lab.url}/s/live")
    page.get_by_test_id("consent").click()
    page.get_by_test_id("continue").click()
    expect(page.get_by_role("heading", name=WAITS)).to_be_visible()


def sign_in(page: Page, lab: Lab) -> None:
    page.goto(f"{lab.url}/sign-in")
    page.get_by_label("Email").fill(EMAIL)
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_test_id("sign-in").click()
    page.wait_for_url("**/studies")


def table(page: Page, lab: Lab, name: str) -> pd.DataFrame:
    """A table of the study's export, as the page's link gives it."""
    got = page.request.get(f"{lab.url}/api/v1/studies/live/export/{name}.csv")
    assert got.ok, got.text()
    return pd.read_csv(io.StringIO(got.text()))


@pytest.mark.long
def test_ten_pairs_of_videos_that_did_not_exist_by_a_machine_that_dies(
    page: Page, browser: Browser, lab: Lab
) -> None:
    enter(page, lab)
    expect(page.get_by_text("No machine is connected at the moment")).to_be_visible()
    assert violations(page) == []
    lab.start_machine()
    for pair in range(PAIRS):
        watch(page)
        if pair == 3:
            lab.kill_machine()
        answer(page, ("left", "right", "skip")[pair % 3], by="button" if pair % 2 else "key")
        if pair == 3:
            lab.start_machine()
    expect(page.get_by_test_id("receipt")).to_be_visible()

    desk = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    sign_in(desk, lab)
    desk.goto(f"{lab.url}/studies/live/machines")
    past = desk.get_by_test_id("past")
    expect(past).to_contain_text("Unsafe: it would hit the wall")
    expect(past).to_contain_text("Failed: motor 3 is cold")
    expect(desk.get_by_test_id("machines")).to_contain_text("Connected")
    assert violations(desk) == []

    rollouts, queries = table(desk, lab, "rollouts"), table(desk, lab, "queries")
    outcomes = rollouts["outcome"].value_counts()
    assert (outcomes["unsafe"], outcomes["failed"] >= 1) == (1, True)
    assert outcomes["recorded"] >= PAIRS / 2
    assert (rollouts["w0"] >= rollouts["w1"]).all()
    answered = queries[queries["response"].notna()]
    assert list(answered["query_index"]) == list(range(PAIRS))
    shown = pd.concat([answered["left_recording"], answered["right_recording"]])
    assert set(shown) <= set(rollouts["recording"].dropna())
    desk.context.close()


def test_the_operator_records_by_hand_on_a_phone_and_the_pair_begins_by_itself(
    page: Page, browser: Browser, lab: Lab
) -> None:
    enter(page, lab)
    context = browser.new_context(viewport=PHONE, is_mobile=True, has_touch=True)  # type: ignore[arg-type]
    context.set_default_timeout(PATIENCE_MS)
    phone = context.new_page()
    sign_in(phone, lab)
    phone.goto(f"{lab.url}/studies/live/machines")
    phone.get_by_test_id("to-desk").tap()
    for _ in range(2):
        phone.get_by_test_id("desk-take").tap()
        expect(phone.get_by_test_id("values")).to_contain_text("Opening time, s")
        assert phone.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        phone.get_by_test_id("desk-video").set_input_files(lab.folder / "video.mp4")
        phone.get_by_test_id("hand-in").tap()
        expect(phone.get_by_test_id("recorded")).to_be_visible()
    assert violations(phone) == []
    watch(page)
    context.close()
