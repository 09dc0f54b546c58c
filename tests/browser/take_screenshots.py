"""Pictures of what an evaluator sees, for docs/evaluator.md: `make screenshots`.

A real Chromium goes through the shipped `waste-crane` study, with a device check, a questionnaire
and a short break added so that there is a page of each kind, and once more on a phone.
"""

from __future__ import annotations

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.study.folder import resolve

from .conftest import ARGUMENTS, chromium
from .evaluator import FIRST_FRAME_MS, watch
from .server import Server

DOCS = Path(__file__).parents[2] / "docs" / "evaluator"
LANGUAGES = ("en", "ja")
DESKTOP = {"width": 1280, "height": 800}
PHONE = {"width": 360, "height": 740}

STUDY = "waste-crane"
#: The same with two parts of one pair each: the pages after the last answer are soon reached.
SHORT = "waste-crane-short"
BREAK_S = 10

#: Pages that are shown on a phone too.
ON_A_PHONE = frozenset({"consent", "familiarisation", "query", "break"})

#: How long videos play before the picture is taken: there is something in the air by then.
PLAY_MS = 3000

#: WebP's measure from 0 to 100: text stays sharp, and a page takes about 30 kB.
QUALITY = 75

ADDED: dict[str, Any] = {
    "device_check": {"min_width_px": 320, "min_mbit_s": 1},
    "questionnaires": {
        "end": [
            {
                "name": "effort",
                "type": "likert",
                "points": 7,
                "label": {"en": "How hard was it to choose?", "ja": "選ぶのは難しかったですか。"},
                "labels": [{"en": "Easy", "ja": "易しかった"}, {"en": "Hard", "ja": "難しかった"}],
            },
            {
                "name": "remarks",
                "type": "text",
                "required": False,
                "label": {
                    "en": "Is there anything we should know?",
                    "ja": "ご意見があればお書きください。",
                },
            },
        ]
    },
}


class Album:
    """The pictures of one language and one size of screen."""

    def __init__(self, page: Page, folder: Path, *, is_phone: bool) -> None:
        self.page = page
        self._folder = folder
        self._is_phone = is_phone

    def take(self, name: str) -> None:
        """A picture of what the screen shows now, unless it is not wanted in this size."""
        if self._is_phone and name not in ON_A_PHONE:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{name}{'-phone' if self._is_phone else ''}.webp"
        with Image.open(io.BytesIO(self.page.screenshot())) as picture:
            picture.convert("RGB").save(path, quality=QUALITY, method=6)
        print(f"{path.relative_to(DOCS.parent)}: {path.stat().st_size / 1000:.0f} kB")

    def go_on(self) -> None:
        self.page.get_by_test_id("continue").click()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("languages", nargs="*", default=LANGUAGES, help="default: all")
    parser.add_argument("--media-dir", type=Path, default=Path("media"))
    options = parser.parse_args()
    for language in options.languages:
        _expect_a_font(language)
    with tempfile.TemporaryDirectory() as folder:
        server = _server(Path(folder), options.media_dir.resolve())
        server.start()
        try:
            _take_all(server, options.languages)
        finally:
            server.stop()


def _expect_a_font(language: str) -> None:
    """End where this machine has no font of a language: the pictures would show empty boxes."""
    found = subprocess.run(["fc-list", f":lang={language}"], check=True, capture_output=True)
    if not found.stdout:
        sys.exit(
            f"expected a font for {language!r}, got none (Debian: apt-get install fonts-noto-cjk);"
            " `python -m tests.browser.take_screenshots en` takes the English pictures alone"
        )


def _server(folder: Path, media_dir: Path) -> Server:
    app = open_app(Settings(data_dir=folder / "data", media_dir=media_dir))
    for slug, changes in (
        (STUDY, ADDED),
        (
            SHORT,
            {
                **ADDED,
                "slug": SHORT,
                "device_check": None,
                "familiarisation": {"videos": 0, "required": 0},
                "queries_per_trial": 1,
                "break_s": BREAK_S,
            },
        ),
    ):
        shutil.copytree(resolve(STUDY), folder / slug)
        plan_file = folder / slug / "study.yaml"
        plan = yaml.safe_load(plan_file.read_text(encoding="utf-8")) | {"order": "fixed"} | changes
        if slug == SHORT:
            plan["conditions"] = plan["conditions"][:2]
        plan = {key: value for key, value in plan.items() if value is not None}
        plan_file.write_text(yaml.safe_dump(plan, allow_unicode=True), encoding="utf-8")
        repository.create(app, repository.load_folder(str(folder / slug)))
        repository.open_study(app, slug)
    app.close()
    return Server(folder / "data", media_dir)


def _take_all(server: Server, languages: Sequence[str]) -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        for language in languages:
            for is_phone in (False, True):
                _take(browser, server, language, is_phone=is_phone)
        browser.close()


def _take(browser: Browser, server: Server, language: str, *, is_phone: bool) -> None:
    size = PHONE if is_phone else DESKTOP
    context = browser.new_context(
        viewport={"width": size["width"], "height": size["height"]},
        is_mobile=is_phone,
        has_touch=is_phone,
    )
    context.set_default_timeout(FIRST_FRAME_MS)
    album = Album(context.new_page(), DOCS / language, is_phone=is_phone)
    _to_the_first_pair(album, f"{server.url}/s/{STUDY}?lang={language}")
    _from_a_break_to_the_end(album, f"{server.url}/s/{SHORT}?lang={language}")
    context.close()


def _to_the_first_pair(album: Album, link: str) -> None:
    page = album.page
    page.goto(link)
    album.take("consent")
    page.get_by_test_id("consent").click()
    expect(page.get_by_test_id("continue")).to_be_enabled()
    album.take("device-check")
    album.go_on()
    page.wait_for_selector("main.page")
    album.take("instructions")
    album.go_on()
    page.wait_for_function(
        """() => document.querySelector('[data-testid="video-familiarisation"]')?.currentTime > 2"""
    )
    album.take("familiarisation")
    album.go_on()
    watch(page)
    page.wait_for_timeout(PLAY_MS)
    album.take("query")
    page.get_by_test_id("withdraw").click()
    page.get_by_test_id("withdraw-back").wait_for()
    album.take("stop")
    page.get_by_test_id("privacy").click()
    page.get_by_test_id("privacy-back").wait_for()
    album.take("privacy")


def _from_a_break_to_the_end(album: Album, link: str) -> None:
    page = album.page
    page.goto(link)
    page.get_by_test_id("consent").click()
    album.go_on()
    watch(page)
    page.keyboard.press("ArrowLeft")
    page.get_by_test_id("countdown").wait_for()
    album.take("break")
    album.go_on()
    watch(page)
    page.keyboard.press("ArrowRight")
    page.get_by_test_id("questionnaire").wait_for()
    page.get_by_role("radio").nth(2).check()
    album.take("questionnaire")
    album.go_on()
    page.get_by_test_id("receipt").wait_for()
    album.take("debrief")
    album.go_on()
    page.wait_for_selector("main.page-centred")
    album.take("completed")


if __name__ == "__main__":
    main()
