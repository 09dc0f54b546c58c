"""The pictures of docs/evaluator.md: all there, and all small."""

from __future__ import annotations

import re

from app.web.http.templating import ROOT

DOCS = ROOT / "docs"
MOST_BYTES = 100_000
MOST_BYTES_TOGETHER = 1_500_000


def test_every_picture_is_there_and_none_is_heavy() -> None:
    text = (DOCS / "evaluator.md").read_text(encoding="utf-8")
    shown = {DOCS / place for place in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)}
    there = set((DOCS / "evaluator").rglob("*.*"))
    assert shown <= there
    sizes = [path.stat().st_size for path in there]
    assert max(sizes) <= MOST_BYTES
    assert sum(sizes) <= MOST_BYTES_TOGETHER
