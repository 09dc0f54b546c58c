"""The stylesheet for browsers without CSS cascade layers: Firefox 91 to 96, Chrome 92 to 98.

They drop `@layer` blocks whole. Without the blocks' heads the same rules stand in the order of the
layers, so that most of them apply alike. `static/js/older_browsers.js` asks for it.
"""

from __future__ import annotations

import re
from functools import lru_cache

from fastapi import APIRouter
from fastapi.responses import Response

from .templating import STATIC

router = APIRouter(include_in_schema=False)

_ORDER = re.compile(r"@layer [\w, ]+;")
_HEAD = re.compile(r"@layer [\w]+ \{")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@router.get("/styles/without-layers.css")
def stylesheet() -> Response:
    """`app.css` without its layers."""
    kept = {"Cache-Control": "public, max-age=3600"}
    return Response(_stylesheet(), media_type="text/css", headers=kept)


@lru_cache(maxsize=1)
def _stylesheet() -> str:
    return without_layers((STATIC / "css" / "app.css").read_text(encoding="utf-8"))


def without_layers(css: str) -> str:
    """The same rules in the same order, outside of layers."""
    css = _ORDER.sub("", _COMMENT.sub("", css))
    while (head := _HEAD.search(css)) is not None:
        end = _end_of_block(css, head.end())
        css = css[: head.start()] + css[head.end() : end] + css[end + 1 :]
    return css


def _end_of_block(css: str, begin: int) -> int:
    """Where the brace is that closes the block whose content begins here."""
    depth = 1
    for brace in re.finditer(r"[{}]", css[begin:]):
        depth += 1 if brace.group() == "{" else -1
        if depth == 0:
            return begin + brace.start()
    raise ValueError("expected every block of the stylesheet to be closed")
