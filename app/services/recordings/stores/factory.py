"""The stores that the settings name."""

from __future__ import annotations

from dataclasses import dataclass

from app.services.runtime.settings import Settings

from .folder import FolderStore
from .interface import Store

#: Folders within a bucket, called as those of a machine are: files can be moved as they lie.
OWN, RENDERED = "uploads", "media"

#: Where a proxy that sends videos has the two folders: deploy/ says the same.
OWN_AT_PROXY, RENDERED_AT_PROXY = "/videos/own", "/videos/rendered"


@dataclass(frozen=True)
class Stores:
    """Where studies' own videos are, which are nowhere else, and where rendered ones are."""

    own: Store
    rendered: Store


def open_stores(settings: Settings) -> Stores:
    """Raises ConflictError if the settings name a store that cannot be used from here."""
    if not settings.recordings_url:
        own, rendered = OWN_AT_PROXY, RENDERED_AT_PROXY
        sends = settings.proxy_sends_videos
        return Stores(
            FolderStore(settings.own_videos, own if sends else None),
            FolderStore(settings.media_dir, rendered if sends else None),
        )
    # Its client takes a while to be imported, and need not be installed.
    from .s3 import S3Store  # noqa: PLC0415
    from .s3_client import Bucket  # noqa: PLC0415

    bucket = Bucket(settings)
    return Stores(S3Store(bucket, OWN), S3Store(bucket, RENDERED))
