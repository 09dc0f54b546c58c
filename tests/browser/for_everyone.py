"""What axe finds of a page: what people with a screen reader or weak eyes would stumble over."""

from __future__ import annotations

from typing import Literal

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page


def violations(page: Page, scheme: Literal["light", "dark"] | None = None) -> list[str]:
    """The rules that the page breaks, each with where, as it is or in these colours."""
    # A button on its way from one colour to another has neither, and a page may go on by itself
    # while axe looks: nothing is ever on its way for those who want no motion.
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    found = Axe().run(page).response["violations"]
    page.emulate_media(reduced_motion="no-preference")
    return [
        f"{rule['id']}: {', '.join(str(node['target']) for node in rule['nodes'])}"
        for rule in found
    ]
