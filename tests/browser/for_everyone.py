"""What axe finds of a page: what people with a screen reader or weak eyes would stumble over."""

from __future__ import annotations

from typing import Literal

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

COLOURS_ARRIVED = """() => Promise.allSettled(
    document.getAnimations()
        .filter((animation) => animation instanceof CSSTransition)
        .map((transition) => transition.finished)
)"""


def violations(page: Page, scheme: Literal["light", "dark"] | None = None) -> list[str]:
    """The rules that the page breaks, each with where, as it is or in these colours."""
    if scheme is not None:
        page.emulate_media(color_scheme=scheme)
    # A button that is on its way from one colour to another has neither.
    page.evaluate(COLOURS_ARRIVED)
    return [
        f"{found['id']}: {', '.join(str(node['target']) for node in found['nodes'])}"
        for found in Axe().run(page).response["violations"]
    ]
