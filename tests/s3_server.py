"""An S3-compatible store on a port of this machine: moto's, behind a door that checks signatures.

Moto lets everybody in, whatever they have signed and however long ago. Real stores do not, and that
is what links are for: the door does as they do.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import threading
from collections.abc import Callable, Iterable
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

import boto3
from werkzeug.serving import BaseWSGIServer, make_server

# Moto would tell every site that it may read everything; a bucket's own rule is to say that.
os.environ["MOTO_DISABLE_GLOBAL_CORS"] = "true"

KEY, SECRET = "an-access-key", "a-secret-key-of-tests"
BUCKET = "recordings"
REGION = "us-east-1"

Wsgi = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]


class S3Server:
    """A store with one empty bucket, to be stopped and started again on the same port."""

    def __init__(self) -> None:
        from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app

        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        moto = DomainDispatcherApplication(create_backend_app)
        self._door = _Door(moto)
        self._server: BaseWSGIServer | None = None
        self._port = 0
        self.start()
        self.client.create_bucket(Bucket=BUCKET)
        # What an earlier one of this process held is moto's still.
        self.empty()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._port}"

    @cached_property
    def client(self) -> Any:
        """A client of its owner's."""
        return boto3.client(
            "s3",
            endpoint_url=self.url,
            region_name=REGION,
            aws_access_key_id=KEY,
            aws_secret_access_key=SECRET,
        )

    def names(self) -> list[str]:
        """The full names of what it holds."""
        return [
            one["Key"] for one in self.client.list_objects_v2(Bucket=BUCKET).get("Contents", [])
        ]

    def read(self, key: str) -> bytes:
        content: bytes = self.client.get_object(Bucket=BUCKET, Key=key)["Body"].read()
        return content

    def empty(self) -> None:
        for key in self.names():
            self.client.delete_object(Bucket=BUCKET, Key=key)
        self._door.ahead = timedelta(0)

    @property
    def asked(self) -> list[str]:
        """Method and path of each request so far."""
        return self._door.asked

    def let_read(self, site: str) -> None:
        """Let scripts of this site, and of no other, read what they have links for."""
        rule = {"AllowedOrigins": [site], "AllowedMethods": ["GET", "HEAD"]}
        self.client.put_bucket_cors(Bucket=BUCKET, CORSConfiguration={"CORSRules": [rule]})

    def forward(self, seconds: float) -> None:
        """Set the store's clock forward."""
        self._door.ahead += timedelta(seconds=seconds)

    def start(self) -> None:
        self._server = make_server("127.0.0.1", self._port, self._door, threaded=True)
        self._port = self._server.port
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        """Answer nobody any more; what it holds is there again after a start."""
        assert self._server is not None
        self._server.shutdown()
        self._server.server_close()


class _Door:
    """Lets in whoever has a key, or a link that was signed with it and is not too old."""

    def __init__(self, inside: Wsgi) -> None:
        self._inside = inside
        self.asked: list[str] = []
        self.ahead = timedelta(0)

    def __call__(self, request: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        self.asked.append(f"{request['REQUEST_METHOD']} {request['PATH_INFO']}")
        if self._may_enter(request):
            return self._inside(request, start)
        start("403 Forbidden", [("Content-Type", "application/xml")])
        return [b"<Error><Code>AccessDenied</Code></Error>"]

    def _may_enter(self, request: dict[str, Any]) -> bool:
        if f"Credential={KEY}/" in request.get("HTTP_AUTHORIZATION", ""):
            return True
        words = dict(parse_qsl(request["QUERY_STRING"], keep_blank_values=True))
        given = words.pop("X-Amz-Signature", "")
        if not given:
            return False
        signed_at = datetime.strptime(words["X-Amz-Date"], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
        ends = signed_at + timedelta(seconds=int(words["X-Amz-Expires"]))
        expected = _signature(request, words)
        return hmac.compare_digest(expected, given) and datetime.now(UTC) + self.ahead < ends


def _signature(request: dict[str, Any], words: dict[str, str]) -> str:
    """What a link has to be signed with: AWS's Signature Version 4, in the query."""
    at, scope = words["X-Amz-Date"], words["X-Amz-Credential"].partition("/")[2]
    asked = "\n".join(
        (
            request["REQUEST_METHOD"],
            quote(request["PATH_INFO"], safe="/-_.~"),
            urlencode(sorted(words.items()), quote_via=quote, safe="-_.~"),
            f"host:{request['HTTP_HOST']}",
            "",
            words["X-Amz-SignedHeaders"],
            "UNSIGNED-PAYLOAD",
        )
    )
    to_sign = "\n".join(("AWS4-HMAC-SHA256", at, scope, hashlib.sha256(asked.encode()).hexdigest()))
    key = f"AWS4{SECRET}".encode()
    for part in scope.split("/"):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    return hmac.new(key, to_sign.encode(), hashlib.sha256).hexdigest()
