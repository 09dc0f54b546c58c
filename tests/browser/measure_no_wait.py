"""How long evaluators wait between a response and the next pair: `make no-wait`.

A real Chromium goes through the shipped `waste-crane` study on a server of its own, with the breaks
cut short, looks at each pair for as long as a person would, and answers by key. What is measured is
the time from the press to the moment when both new videos play.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import BrowserContext, Page, sync_playwright

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.study.folder import resolve

from .conftest import ARGUMENTS, chromium
from .evaluator import FIRST_FRAME_MS, may_skip, query_on_screen
from .server import Server

STUDY = "waste-crane"

#: From here on a person sees that something is waited for (Doherty and Thadani, 1982).
VISIBLE_MS = 400.0

#: A little of how people take longer for some pairs than for others, as a part of the least time.
MOST_HESITATION = 0.3

#: What an evaluator presses: the model learns as it does from people, who skip now and then.
RESPONSES = (*["ArrowLeft"] * 9, *["ArrowRight"] * 9, *["ArrowDown"] * 2)

#: Notes when a response is pressed, when both videos of the next pair play, and when both have
#: shown a frame that is not their first.
WATCHER = """() => {
    const waits = [];
    let pressedAt = null;
    let playing = new Map();
    let moving = new Map();
    const look = (video) => video.requestVideoFrameCallback((now, {mediaTime}) => {
        if (video.paused || mediaTime === 0) {
            look(video);
            return;
        }
        moving.set(video.dataset.testid, now);
        if (moving.size === 2) {
            document.documentElement.dataset.moving = "yes";
            if (pressedAt !== null) {
                const last = (times) => Math.max(...times.values()) - pressedAt;
                waits.push([last(playing), last(moving)]);
                pressedAt = null;
            }
        }
    });
    window.waits = waits;
    document.addEventListener("loadstart", ({target}) => look(target), true);
    document.addEventListener("playing", ({target, timeStamp}) => {
        playing.set(target.dataset.testid, timeStamp);
    }, true);
    document.addEventListener("keydown", (event) => {
        if (event.key.startsWith("Arrow")) {
            pressedAt = event.timeStamp;
            playing = new Map();
            moving = new Map();
            delete document.documentElement.dataset.moving;
        }
    }, true);
}"""

MOVING = "() => document.documentElement.dataset.moving === 'yes'"


#: One wait in milliseconds: until both next videos play, and until both show their second frame.
Wait = tuple[float, float]


@dataclass(frozen=True)
class Waits:
    """Many waits in milliseconds; those on which a person sees that they wait are counted."""

    median: float
    p95: float
    longest: float
    visible: int

    @classmethod
    def of(cls, waits: Sequence[float]) -> Waits:
        values = np.asarray(waits, dtype=np.float64)
        median, p95 = np.percentile(values, [50, 95])
        return cls(
            median=round(float(median)),
            p95=round(float(p95)),
            longest=round(float(values.max())),
            visible=int((values > VISIBLE_MS).sum()),
        )


def main() -> None:
    options = _options()
    random.seed(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        media_dir = options.media_dir or Path(folder) / "media"
        made_before = len(list(media_dir.glob("*.mp4")))
        server = _server(Path(folder), media_dir)
        server.start()
        try:
            waits = _measure(server, options)
        finally:
            server.stop()
        made = len(list(media_dir.glob("*.mp4"))) - made_before
    playing, moving = zip(*waits, strict=True)
    line = f"{options.mbit_s:g} Mbit/s" if options.mbit_s else "loopback"
    print(
        f"{len(waits)} waits over {line}, at least {options.look_s:g} s a pair; {made} videos made"
    )
    for name, found in (("playing", Waits.of(playing)), ("second frame", Waits.of(moving))):
        print(f"{name}: {asdict(found)}")
    if options.all:
        print(json.dumps([[round(time) for time in wait] for wait in waits]))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queries", type=int, default=60, help="how many waits to measure")
    parser.add_argument("--look-s", type=float, default=1.5, help="least time a pair is looked at")
    parser.add_argument("--mbit-s", type=float, default=None, help="throttle the line to this")
    parser.add_argument("--latency-ms", type=float, default=40.0, help="of the throttled line")
    parser.add_argument("--seed", type=int, default=1, help="of the responses and the looks")
    parser.add_argument("--all", action="store_true", help="print every single wait as well")
    parser.add_argument(
        "--media-dir", type=Path, default=None, help="rendered recordings; default: none are there"
    )
    return parser.parse_args()


def _server(folder: Path, media_dir: Path) -> Server:
    """A server with the shipped study opened; only its breaks are cut short."""
    study = folder / "study"
    shutil.copytree(resolve(STUDY), study)
    plan = study / "study.yaml"
    plan.write_text(plan.read_text(encoding="utf-8").replace("break_s: 120", "break_s: 1"))
    app = open_app(Settings(data_dir=folder / "data", media_dir=media_dir))
    repository.create(app, repository.load_folder(str(study)))
    repository.open_study(app, STUDY)
    app.close()
    return Server(folder / "data", media_dir)


def _measure(server: Server, options: argparse.Namespace) -> list[Wait]:
    """Session after session, each in a browser that has seen nothing, until all is measured."""
    waits: list[Wait] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        while len(waits) < options.queries:
            context = browser.new_context(viewport={"width": 1280, "height": 800})
            context.set_default_timeout(FIRST_FRAME_MS)
            waits.extend(_session(context, server, options, options.queries - len(waits)))
            context.close()
        browser.close()
    return waits


def _session(
    context: BrowserContext, server: Server, options: argparse.Namespace, wanted: int
) -> list[Wait]:
    """One person's session, as far as it is needed."""
    page = context.new_page()
    page.add_init_script(f"({WATCHER})()")
    if options.mbit_s is not None:
        _throttle(page, options.mbit_s, options.latency_ms)
    page.goto(f"{server.url}/s/{STUDY}")
    for step in ("consent", "continue", "continue"):
        with page.expect_navigation(wait_until="commit"):
            page.get_by_test_id(step).click()
    waits: list[Wait] = []
    while len(waits) < wanted and page.get_by_test_id("answer-left").count():
        waits.extend(_trial(page, options.look_s, wanted - len(waits)))
        if len(waits) < wanted:
            with page.expect_navigation(wait_until="commit"):
                page.get_by_test_id("continue").click()
    return waits


def _trial(page: Page, look_s: float, wanted: int) -> list[Wait]:
    """The waits within one trial: between two trials comes a page of its own."""
    waits: list[Wait] = []
    page.wait_for_function(MOVING)
    while len(waits) < wanted:
        time.sleep(look_s * (1 + random.uniform(0, MOST_HESITATION)))
        key = random.choice(RESPONSES)
        if key == "ArrowDown" and not may_skip(page):
            key = "ArrowLeft"
        page.wait_for_selector('[data-testid="answer-left"][aria-disabled="false"]')
        number, numbers = re.findall(r"\d+", query_on_screen(page))[-2:]
        if number == numbers:
            with page.expect_navigation(wait_until="commit"):
                page.keyboard.press(key)
            break
        page.keyboard.press(key)
        page.wait_for_function(MOVING)
        until_playing, until_moving = page.evaluate("() => window.waits.at(-1)")
        waits.append((until_playing, until_moving))
    return waits


def _throttle(page: Page, mbit_s: float, latency_ms: float) -> None:
    line = page.context.new_cdp_session(page)
    line.send("Network.enable")
    bytes_per_s = mbit_s * 1e6 / 8
    line.send(
        "Network.emulateNetworkConditions",
        {
            "offline": False,
            "latency": latency_ms,
            "downloadThroughput": bytes_per_s,
            "uploadThroughput": bytes_per_s,
        },
    )


if __name__ == "__main__":
    main()
