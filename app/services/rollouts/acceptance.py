"""From uploaded bytes to a recording: digest, decoding, transcoding, storing, and the outcome.

What a machine sends is treated as the videos of a study folder are: it is decoded to its end in a
process with limits, transcoded if some browser cannot play it, and remuxed without its metadata.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from app.services.context import AppContext
from app.services.recordings import recordings
from app.services.runtime.errors import OtherBytesError, RecordingRefusedError, StoreAwayError
from app.services.runtime.ids import new_public_id
from app.services.studies import orphaned_videos
from app.storage.models.rollouts import Rollout
from app.video.decoder_client import Decoder
from app.video.video_info import UnreadableVideoError

from . import claims, outcomes, reports, states
from .machines import MachineCaller
from .outcomes import Made
from .uploads import Upload

#: Algorithms of digests that are checked, by their names in RFC 3230 and RFC 9530.
DIGESTS: Final[Mapping[str, str]] = {"sha-256": "sha256", "sha-512": "sha512"}

_OVER: Final = (states.CANCELLED, states.UNSAFE, states.WITHDRAWN, states.RECORDED)


class Verdict(StrEnum):
    """What became of an uploaded recording."""

    RECORDED = "recorded"
    #: The same bytes were recorded before.
    SAME = "same"
    #: The rollout had ended otherwise: another machine recorded it, or it was cancelled.
    NOT_KEPT = "not kept"


@dataclass(frozen=True)
class Accepted:
    """The verdict, the rollout's status, and a sentence for one that was not kept."""

    verdict: Verdict
    status: str
    said: str = ""


def finish(
    app: AppContext,
    caller: MachineCaller,
    public_id: str,
    attempt: int | None,
    upload: Upload,
    digests: Mapping[str, bytes],
) -> Accepted:
    """Turn a whole upload into the recording of its rollout. Takes as long as decoding does.

    A machine that has lost its lease may finish too, unless the rollout has ended otherwise.
    digests: expected digests of all bytes, by algorithm (see DIGESTS). The partial file is deleted
    unless a StoreAwayError says that the machine should send the last part again.

    Raises RecordingRefusedError if a digest differs, or if the bytes are no video that can be
    shown, by which the attempt has failed. Raises OtherBytesError if the machine has recorded other
    bytes.
    """
    upload.force_to_disk()
    with _whole(upload.path) as path:
        sha256 = _checked(path, digests)
        if found := _outcome(app, caller, public_id, attempt, sha256):
            return found
        with tempfile.TemporaryDirectory(prefix="recording-", dir=app.settings.data_dir) as folder:
            try:
                video, duration_s = _playable(path, Path(folder), sha256)
            except UnreadableVideoError as error:
                said = f"expected a video that can be played: {error}"
                fail(app, caller, public_id, attempt, said)
                raise RecordingRefusedError(said) from None
            made = Made(locator=video.name, sha256=sha256, duration_s=duration_s)
            return keep(app, caller, public_id, attempt, video, made)


def fail(
    app: AppContext, caller: MachineCaller, public_id: str, attempt: int | None, said: str
) -> None:
    """End the attempt as failed, since its recording was refused, if the machine still holds it."""
    with app.database.write() as db:
        rollout = outcomes.locked(db, caller.study_id, public_id)
        if claims.holds(rollout, caller, attempt):
            reports.fail_attempt(app, db, rollout, caller, said)


def keep(
    app: AppContext,
    caller: MachineCaller,
    public_id: str,
    attempt: int | None,
    video: Path,
    made: Made,
) -> Accepted:
    """Put a playable video into the store and end its rollout as recorded.

    The machine's numbers on the run that were reported before are kept unless `made` has others.
    Raises StoreAwayError or OtherBytesError.
    """
    with orphaned_videos.mark_in_use(app, [made.locator]):
        # Stored first, named by its content: a video that no recording refers to does no harm.
        app.recordings.keep_files({made.locator: video})
        with app.database.write() as db:
            rollout = outcomes.locked(db, caller.study_id, public_id)
            found = _ended(rollout, caller, attempt, made.sha256)
            if found is None:
                holds = claims.holds(rollout, caller, attempt)
                numbers = Made(
                    locator=made.locator,
                    sha256=made.sha256,
                    duration_s=made.duration_s,
                    score=rollout.score if made.score is None and holds else made.score,
                    series=rollout.series if made.series is None and holds else made.series,
                )
                outcomes.record(db, rollout, numbers, caller.machine_id, app.now())
                return Accepted(Verdict.RECORDED, rollout.status)
    if found.verdict is not Verdict.SAME:
        orphaned_videos.mark_orphaned(app, [made.locator])
    return found


def _outcome(
    app: AppContext, caller: MachineCaller, public_id: str, attempt: int | None, sha256: str
) -> Accepted | None:
    with app.database.write() as db:
        rollout = outcomes.locked(db, caller.study_id, public_id)
        return _ended(rollout, caller, attempt, sha256)


def _ended(
    rollout: Rollout, caller: MachineCaller, attempt: int | None, sha256: str
) -> Accepted | None:
    """The answer for a rollout that takes no recording any more; None if it still does."""
    if rollout.status not in _OVER:
        return None
    if rollout.sha256 == sha256:
        return Accepted(Verdict.SAME, rollout.status)
    is_own = rollout.machine_id == caller.machine_id and attempt in (None, rollout.attempt)
    if rollout.sha256 is not None and is_own:
        raise OtherBytesError(
            f"expected the recording of SHA-256 {rollout.sha256}, which is recorded and never"
            f" replaced, got {sha256}"
        )
    said = {
        states.RECORDED: "another machine or attempt has recorded this rollout meanwhile",
        states.WITHDRAWN: "this rollout was recorded and withdrawn",
        states.CANCELLED: "this rollout was cancelled",
        states.UNSAFE: "these parameters were reported to be unsafe",
    }
    return Accepted(Verdict.NOT_KEPT, rollout.status, said[rollout.status])


@contextmanager
def _whole(part: Path) -> Iterator[Path]:
    """A second name of the file, so that a request which finishes at the same time deletes its own.

    Both names are deleted at the end, but for an error that is not the machine's: the upload is
    whole then, and is finished when the machine asks again.
    """
    whole = part.with_name(f"{part.stem}-{new_public_id()}.whole")
    try:
        _link(part, whole)
    except OSError as error:
        raise StoreAwayError(f"the recording cannot be kept: {error.strerror}") from error
    try:
        yield whole
        part.unlink(missing_ok=True)
    except (RecordingRefusedError, OtherBytesError):
        part.unlink(missing_ok=True)
        raise
    finally:
        whole.unlink(missing_ok=True)


def _link(part: Path, whole: Path) -> None:
    try:
        os.link(part, whole)
    except FileNotFoundError:
        raise
    except OSError:
        # Not every file system has links.
        shutil.copyfile(part, whole)


def _checked(path: Path, digests: Mapping[str, bytes]) -> str:
    """SHA-256 of the file. Raises RecordingRefusedError if an expected digest differs."""
    for algorithm, expected in digests.items():
        with path.open("rb") as content:
            came = hashlib.file_digest(content, DIGESTS[algorithm]).digest()
        if came != expected:
            raise RecordingRefusedError(
                f"expected bytes whose {algorithm} is {expected.hex()}, got {came.hex()}: send the"
                " recording again from its first byte"
            )
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _playable(path: Path, folder: Path, sha256: str) -> tuple[Path, float]:
    """A copy that every browser plays, without metadata, named as its locator; and its seconds.

    Raises UnreadableVideoError.
    """
    with Decoder() as decoder:
        video = decoder.probe(path)
        if video.hindrance is not None:
            transcoded = folder / "transcoded.mp4"
            decoder.transcode(path, transcoded)
            path, video = transcoded, decoder.probe(transcoded)
        copy = folder / "copy"
        form = decoder.remux(path, copy)
    return copy.rename(copy.with_name(recordings.file_locator(sha256, form))), video.duration_s
