"""Opens the stores that the settings name: two folders, or two prefixes of an S3 bucket."""

from __future__ import annotations

from dataclasses import dataclass

from app.services.runtime.settings import Settings

from .folder import FolderStore
from .interface import Store

#: Prefixes within a bucket, named like the local folders, so that files can be moved as they are.
OWN, RENDERED = "uploads", "media"

#: Internal paths of the two folders at a proxy that sends videos; the same as in deploy/.
OWN_AT_PROXY, RENDERED_AT_PROXY = "/videos/own", "/videos/rendered"


@dataclass(frozen=True)
class Stores:
    """own: studies' own videos, which exist nowhere else. rendered: can be rendered again."""

    own: Store
    rendered: Store


def open_stores(settings: Settings) -> Stores:
    """Open the stores. Raises ConflictError if the S3 client or its credentials are missing."""
    if not settings.recordings_url:
        own, rendered = OWN_AT_PROXY, RENDERED_AT_PROXY
        sends = settings.proxy_sends_videos
        return Stores(
            FolderStore(settings.own_videos, own if sends else None),
            FolderStore(settings.media_dir, rendered if sends else None),
        )
    # The S3 client is slow to import and need not be installed.
    from .s3 import S3Store  # noqa: PLC0415
    from .s3_client import Bucket  # noqa: PLC0415

    bucket = Bucket(settings)
    return Stores(S3Store(bucket, OWN), S3Store(bucket, RENDERED))
