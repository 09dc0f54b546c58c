"""Client of one bucket of an S3-compatible store: timeouts, a circuit breaker, and signed URLs."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from app.services.runtime.errors import ConflictError, StoreAwayError
from app.services.runtime.settings import Settings

try:
    import boto3
    from botocore.config import Config
    from botocore.exceptions import BotoCoreError, ClientError
except ImportError:
    raise ConflictError(
        "PBPO_RECORDINGS_URL names an S3-compatible store, and its client is not installed:"
        " pip install 'pbpo-studio[s3]'"
    ) from None

log = logging.getLogger(__name__)

#: Timeouts of a request in seconds: people and health checks wait for it.
CONNECT_S = 2.0
READ_S = 10.0
#: After a failure, requests fail immediately for this many seconds instead of timing out.
AWAY_S = 5.0
#: Size of the connection pool: as many as the server has threads.
_CONNECTIONS = 40
#: Region used to sign for stores that have no regions.
_REGION = "us-east-1"

AWAY = "the store of recordings cannot be reached"


class Bucket:
    """The bucket and prefix that the settings name.

    Raises ConflictError if boto3 finds no credentials (variables, files, the machine's role).
    """

    def __init__(self, settings: Settings) -> None:
        place = urlsplit(settings.recordings_url)
        self._name, self._prefix = place.netloc, place.path.strip("/")
        self._away_until = 0.0
        session = _session()
        public = settings.s3_public_endpoint
        self._client = _client(session, self._name, settings.s3_endpoint)
        self._signer = _client(session, self._name, public) if public else self._client
        #: Origin of the signed URLs.
        self.origin = origin_of(self.sign("get_object", "any", 1))

    def key(self, folder: str, name: str) -> str:
        """The object key of a file in a folder under the prefix. Raises ValueError for a path."""
        if "/" in name:
            raise ValueError(f"expected the name of a file, got the path {name!r}")
        return "/".join(part for part in (self._prefix, folder, name) if part)

    def call(self, operation: str, **words: Any) -> Mapping[str, Any] | None:
        """Call an operation of the S3 client. Returns None for a 404. Raises StoreAwayError.

        words: arguments of the operation besides the bucket.
        """
        now = time.monotonic()
        if now < self._away_until:
            raise StoreAwayError(AWAY)
        if self._away_until:
            # This call tries again; concurrent ones still fail immediately.
            self._away_until = now + AWAY_S
        with self.errors_as_store_away():
            try:
                answer: Mapping[str, Any] = getattr(self._client, operation)(
                    Bucket=self._name, **words
                )
            except ClientError as error:
                self._away_until = 0.0
                code = _code(error)
                if code in ("404", "NoSuchKey", "NotFound"):
                    return None
                # Only the code: the store's message may contain addresses.
                log.error("the store of recordings refuses %s: %s", operation, code)
                raise StoreAwayError(f"the store of recordings refuses: {code}") from None
        self._away_until = 0.0
        return answer

    @contextmanager
    def errors_as_store_away(self) -> Iterator[None]:
        """Convert connection errors to StoreAwayError, and open the circuit breaker."""
        try:
            yield
        except BotoCoreError as error:
            self._away_until = time.monotonic() + AWAY_S
            log.error("the store of recordings cannot be reached: %s", type(error).__name__)
            raise StoreAwayError(AWAY) from None

    def sign(self, operation: str, key: str, seconds: int, **words: Any) -> str:
        """A URL signed for one operation, valid for `seconds`. Makes no network call."""
        with self.errors_as_store_away():
            link: str = self._signer.generate_presigned_url(
                operation,
                Params={"Bucket": self._name, "Key": key, **words},
                ExpiresIn=seconds,
            )
        return link

    def close(self) -> None:
        """Close the connections."""
        for client in {self._client, self._signer}:
            client.close()


def origin_of(url: str) -> str:
    """Scheme, host and port of a URL."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc}"


def _session() -> Any:
    said = "none were found"
    try:
        db = boto3.session.Session()
        if db.get_credentials() is not None:
            return db
    except BotoCoreError as error:
        said = str(error)
    raise ConflictError(
        "expected credentials for the store of recordings where boto3 looks for them, such as"
        f" AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, and {said}"
    )


def _client(session: Any, bucket: str, endpoint: str) -> Any:
    return session.client(
        "s3",
        endpoint_url=endpoint or None,
        region_name=session.region_name or _REGION,
        config=Config(
            signature_version="s3v4",
            # Self-hosted stores rarely have a host name for each bucket. Amazon does, and signs for
            # the region's host name only in this style; no certificate covers names with dots.
            s3={"addressing_style": "path" if endpoint or "." in bucket else "virtual"},
            connect_timeout=CONNECT_S,
            read_timeout=READ_S,
            retries={"mode": "standard", "total_max_attempts": 2},
            max_pool_connections=_CONNECTIONS,
            # Not every store supports the newer checksums.
            request_checksum_calculation="when_required",
            response_checksum_validation="when_required",
        ),
    )


def _code(error: Any) -> str:
    return str(error.response.get("Error", {}).get("Code", "no reason given"))
