"""What is in a video, looked up once for each content: a check decodes each video to its end."""

from __future__ import annotations

from pathlib import Path

from app.video.decoding import Decoder
from app.video.facts import DecoderFailedError, NotTriedError, UnreadableVideoError, Video

#: What was found, or why nothing could be: by the hash of the content.
_KNOWN: dict[str, Video | str] = {}
#: On what the decoder failed, with the time of the file: whoever sends it again has it tried again.
_FAILED: dict[tuple[str, int], str] = {}


def look(decoder: Decoder, path: Path, sha256: str) -> Video:
    """What the video of this content is. Raises UnreadableVideoError, OSError."""
    sent = (sha256, path.stat().st_mtime_ns)
    if sent in _FAILED:
        raise DecoderFailedError(_FAILED[sent])
    found = _KNOWN.get(sha256)
    if found is None:
        try:
            found = decoder.probe(path)
        except DecoderFailedError as error:
            _FAILED[sent] = str(error)
            raise
        except NotTriedError:
            raise
        except UnreadableVideoError as error:
            found = str(error)
        _KNOWN[sha256] = found
    if isinstance(found, str):
        raise UnreadableVideoError(found)
    return found
