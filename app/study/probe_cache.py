"""Cache of probed videos by content hash: each probe decodes a video to its end."""

from __future__ import annotations

from pathlib import Path
from threading import Lock

from cachetools import LRUCache

from app.video.decoder_client import Decoder
from app.video.video_info import DecoderFailedError, NotTriedError, UnreadableVideoError, Video

#: Videos whose result is cached: those of a large study, twice.
MAX_VIDEOS = 20_000
#: Result or error, by the hash of the content.
_found: LRUCache[str, Video | str] = LRUCache(MAX_VIDEOS)
#: Videos on which the decoder failed, with the file's time: a new upload is tried again.
_failed: LRUCache[tuple[str, int], str] = LRUCache(MAX_VIDEOS)


_lock = Lock()


def probe(decoder: Decoder, path: Path, sha256: str) -> Video:
    """Information about the video with this content. Raises UnreadableVideoError, OSError."""
    sent = (sha256, path.stat().st_mtime_ns)
    with _lock:
        failure, found = _failed.get(sent), _found.get(sha256)
    if failure is not None:
        raise DecoderFailedError(failure)
    if found is None:
        try:
            found = decoder.probe(path)
        except DecoderFailedError as error:
            with _lock:
                _failed[sent] = str(error)
            raise
        except NotTriedError:
            raise
        except UnreadableVideoError as error:
            found = str(error)
        with _lock:
            _found[sha256] = found
    if isinstance(found, str):
        raise UnreadableVideoError(found)
    return found
