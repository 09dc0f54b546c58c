"""What the stylesheet promises of every page."""

from __future__ import annotations

import re

from app.web.http.templating import STATIC

CSS = re.sub(r"/\*.*?\*/", "", (STATIC / "css" / "app.css").read_text(), flags=re.DOTALL)


def rules() -> list[tuple[str, tuple[str, ...]]]:
    """Each selector with the conditions and layers that it stands in."""
    found: list[tuple[str, tuple[str, ...]]] = []
    around: list[str] = []
    for text, mark in re.findall(r"([^{};]*)([{};])", CSS):
        head = " ".join(text.split())
        if mark == "{":
            if not head.startswith("@"):
                found.append((head, tuple(around)))
            around.append(head)
        elif mark == "}":
            around.pop()
    assert around == []
    return found


def test_nothing_looks_pointed_at_where_there_is_no_pointer() -> None:
    """After a touch a browser leaves `:hover` on what was touched: on the answer just given."""
    hovering = [(head, around) for head, around in rules() if ":hover" in head]
    assert len(hovering) > 5
    assert [head for head, around in hovering if "@media (hover: hover)" not in around] == []


def test_the_layout_of_a_pair_needs_no_selector_that_current_browsers_lacked_in_2022() -> None:
    pairs = [head for head, _ in rules() if ".pair" in head or ".player" in head]
    assert pairs
    assert [head for head in pairs if ":has(" in head] == []
