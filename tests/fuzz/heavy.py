"""Bodies near the limit of their route that cost as much as they can: what they hold, by chance."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from hypothesis import strategies as st

from app.web.http.body_limit import limit_of

JSON: Final = "application/json"
FORM: Final = "application/x-www-form-urlencoded"
PARTS: Final = "multipart/form-data; boundary=b"

#: What a route is sent that counts uploads for itself.
_OF_UPLOADS: Final = 2_000_000


@dataclass(frozen=True)
class Body:
    """One body, by the name of its kind."""

    kind: str
    content: bytes
    content_type: str

    def __repr__(self) -> str:
        return f"Body({self.kind!r}, {len(self.content):,} bytes, {self.content[:80]!r})"


def _times(piece: bytes) -> Callable[[int], bytes]:
    return lambda size: piece * (size // len(piece))


def _json(make: Callable[[int], Any], each: int) -> Callable[[int], bytes]:
    """A value with so many entries that it has about the size."""
    return lambda size: json.dumps(make(max(1, size // each)), ensure_ascii=False).encode()


def _keys(number: int) -> dict[str, int]:
    return {f"k{index:07}": 0 for index in range(number)}


def _event(**more: Any) -> dict[str, Any]:
    return {"event": "stall", "time_ms": 1, **more}


_PART = b'--b\r\nContent-Disposition: form-data; name="a"\r\n\r\nx\r\n'
_FILE = b'--b\r\nContent-Disposition: form-data; name="files"; filename="a"\r\n\r\nx\r\n'

#: What a body can be filled with up to a size.
KINDS: Final[dict[str, tuple[str, Callable[[int], bytes]]]] = {
    "keys": (JSON, _json(_keys, 13)),
    "one key": (JSON, lambda size: json.dumps({"k" * size: 0}).encode()),
    "keys within": (JSON, _json(lambda n: {"answers": _keys(n), "external_ids": _keys(n)}, 26)),
    "device": (JSON, _json(lambda n: {"device": _keys(n)}, 13)),
    "events": (JSON, _json(lambda n: {"events": [_event()] * n, "query_id": "x"}, 34)),
    "wrong events": (JSON, _json(lambda n: {"events": [{"x": 0}] * n}, 10)),
    "fat events": (JSON, _json(lambda n: {"events": [_event(value="日" * 99)] * n}, 350)),
    "one event": (JSON, _json(lambda n: {"events": [_keys(n)]}, 13)),
    "levels": (JSON, _times(b"[")),
    "objects": (JSON, _times(b'{"a":')),
    "lists": (JSON, lambda size: b'{"events":[' + b"[]," * (size // 3) + b"[]]}"),
    "numbers": (JSON, lambda size: b"[" + b"1e308," * (size // 6) + b"1]"),
    "a number": (JSON, _times(b"9")),
    "escapes": (JSON, lambda size: b'{"reason":"' + b"\\u0001" * (size // 6) + b'"}'),
    "surrogates": (JSON, lambda size: b'{"reason":"' + b"\\ud800" * (size // 6) + b'"}'),
    "blanks": (JSON, _times(b" ")),
    "separators": (FORM, _times(b"&")),
    "fields": (FORM, _times(b"a=b&")),
    "semicolons": (FORM, _times(b"a=b;")),
    "percents": (FORM, lambda size: b"text=" + b"%E6%97%A5" * (size // 9)),
    "no percents": (FORM, lambda size: b"text=" + b"%" * size),
    "a name": (FORM, _times(b"a")),
    "parts": (PARTS, lambda size: _PART * (size // len(_PART)) + b"--b--\r\n"),
    "files": (PARTS, lambda size: _FILE * (size // len(_FILE)) + b"--b--\r\n"),
    "headers of a part": (PARTS, lambda size: b"--b\r\n" + b"a: b\r\n" * (size // 6)),
    "a header of a part": (PARTS, lambda size: b"--b\r\na: " + b"b" * size),
    "nearly boundaries": (PARTS, lambda size: _PART[:-3] + b"\r\n--" * (size // 4)),
}


@st.composite
def bodies(draw: st.DrawFn, path: str) -> Body:
    """A body for this path: below its limit, at it, or above it."""
    kind = draw(st.sampled_from(sorted(KINDS)))
    limit = limit_of(path)
    size = int((limit or _OF_UPLOADS) * draw(st.sampled_from([0.5, 0.98, 1.0, 1.1])))
    content_type, fill = KINDS[kind]
    content = fill(size)
    return Body(kind, content[: size if limit else len(content)], content_type)
