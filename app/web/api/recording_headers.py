"""Headers of an uploaded recording: which part of it the body is, and its digests.

`Content-Range` is that of RFC 9110, 14.4, as a request's; `Repr-Digest` is RFC 9530, `Digest` the
older RFC 3230.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterator
from typing import Final

from starlette.datastructures import Headers

from app.services.rollouts.acceptance import DIGESTS
from app.services.rollouts.uploads import Part
from app.services.runtime.errors import RecordingRefusedError

#: Digits of a length or a position.
_RANGE: Final = re.compile(r"bytes (?:([0-9]{1,15})-([0-9]{1,15})|\*)/([0-9]{1,15})")
_DIGEST: Final = re.compile(r"\s*([A-Za-z0-9-]+)\s*=\s*(:?)([A-Za-z0-9+/=_-]*)(:?)\s*")


def part_of(headers: Headers) -> Part:
    """Where the body belongs. Raises RecordingRefusedError for a range that cannot be read.

    `Content-Range: bytes 0-999/5000` is a part, and `bytes */5000`, with an empty body, asks how
    much has arrived: its part begins at 0 and has no bytes.
    """
    if headers.get("content-encoding", "identity").lower() != "identity":
        coding = headers["content-encoding"][:60]
        raise RecordingRefusedError(f"expected the bytes of a video, got the encoding {coding!r}")
    length = _length(headers)
    said = headers.get("content-range")
    if said is None:
        return Part(0, length)
    found = _RANGE.fullmatch(said.strip())
    if found is None:
        raise RecordingRefusedError(
            "expected Content-Range as in bytes 0-999/5000, or bytes */5000 to ask how much has"
            f" arrived, got {said[:60]!r}"
        )
    total = int(found[3])
    if found[1] is None:
        if length not in (0, None):
            raise RecordingRefusedError("expected no body with Content-Range: bytes */...")
        return Part(0, total)
    first, last = int(found[1]), int(found[2])
    if not first <= last < total:
        raise RecordingRefusedError(
            f"expected a first byte, a last byte and a length in this order, got {said[:60]!r}"
        )
    if length is not None and length != last - first + 1:
        raise RecordingRefusedError(
            f"expected {last - first + 1:,} bytes as Content-Range says, and Content-Length is"
            f" {length:,}"
        )
    return Part(first, total)


def digests_of(headers: Headers) -> dict[str, bytes]:
    """The digests of the whole recording by algorithm; algorithms not in DIGESTS are left out.

    Raises RecordingRefusedError for a digest that cannot be read.
    """
    found: dict[str, bytes] = {}
    for name in ("digest", "repr-digest"):
        for said in headers.getlist(name):
            for algorithm, value in _digests(name, said):
                if found.setdefault(algorithm, value) != value:
                    raise RecordingRefusedError(f"expected one {algorithm}, got two that differ")
    return found


def _digests(name: str, said: str) -> Iterator[tuple[str, bytes]]:
    for one in said.split(","):
        read = _DIGEST.fullmatch(one)
        if read is None or bool(read[2]) != bool(read[4]):
            raise RecordingRefusedError(
                f"expected {name} as in sha-256=:BASE64:, got {one.strip()[:100]!r}"
            )
        algorithm = read[1].lower()
        if algorithm not in DIGESTS:
            continue
        try:
            yield algorithm, base64.b64decode(read[3], validate=True)
        except binascii.Error:
            raise RecordingRefusedError(
                f"expected {algorithm} in base64, got {read[3][:100]!r}"
            ) from None


def _length(headers: Headers) -> int | None:
    said = headers.get("content-length", "")
    return int(said) if said.isascii() and said.isdecimal() and len(said) < 16 else None
