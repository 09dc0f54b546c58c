"""How long the page of a study with many sessions takes to open: `make watching`.

A real Chromium opens the page of the shipped `waste-crane` study with 200 sessions of 90 queries on
a server of its own, several times. Measured are the server's answer, and the moment at which the
browser has painted the whole of it; the first opening counts what later ones find remembered.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from app.services.accounts import accounts
from app.services.bootstrap import open_app
from app.services.runtime.settings import Settings
from app.services.studies import repository

from .big_study import fill
from .conftest import ARGUMENTS, EMAIL, PASSWORD, chromium
from .server import Server

STUDY = "waste-crane"

#: Until the browser has answered, laid out and painted what came: two frames after it was loaded.
OPENED = """() => new Promise((resolve) => {
    const told = () => requestAnimationFrame(() => requestAnimationFrame(() => {
        const [entry] = performance.getEntriesByType("navigation");
        resolve({answered: entry.responseEnd, painted: performance.now(),
            rows: document.querySelectorAll("[data-session]").length,
            bytes: entry.decodedBodySize});
    }));
    if (document.readyState === "complete") { told(); } else { addEventListener("load", told); }
})"""


def measure(page: Page, url: str) -> dict[str, float]:
    page.goto(url, wait_until="commit")
    times: dict[str, float] = page.evaluate(OPENED)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--times", type=int, default=7)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder) / "data", media_dir=Path(folder) / "media")
        app = open_app(settings)
        repository.create(app, repository.load_folder(STUDY))
        repository.open_study(app, STUDY)
        fill(app, repository.find(app, STUDY), asked.sessions)
        accounts.create(app, EMAIL, PASSWORD)
        app.close()
        server = Server(settings.data_dir, settings.media_dir)
        server.start()
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                page.goto(f"{server.url}/sign-in")
                page.get_by_label("Email").fill(EMAIL)
                page.get_by_label("Password").fill(PASSWORD)
                page.get_by_test_id("sign-in").click()
                page.wait_for_url("**/studies")
                url = f"{server.url}/studies/{STUDY}"
                found = [measure(page, url) for _ in range(asked.times)]
                browser.close()
        finally:
            server.stop()
    first, later = found[0], found[1:]
    print(f"{first['rows']:.0f} sessions, {first['bytes'] / 1000:.0f} kB")
    print(f"first opening: answered {first['answered']:.0f} ms, painted {first['painted']:.0f} ms")
    for name in ("answered", "painted"):
        times = [times[name] for times in later]
        print(f"later, {name}: median {statistics.median(times):.0f} ms, most {max(times):.0f} ms")


if __name__ == "__main__":
    main()
