"""One machine of a load test: `pbpo_machine.py` as users run it, with a run that only waits.

`python machine.py URL STUDY TOKEN VIDEO NOTES SECONDS` appends a line of JSON to NOTES for each run
that it begins and for each upload that the studio has acknowledged. What it uploads is VIDEO with
random bytes behind it that players pass over, so that what is stored tells which run it came from.
"""

from __future__ import annotations

import hashlib
import http.client
import importlib.util
import json
import os
import random
import secrets
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

PROGRAM = Path(__file__).parents[2] / "static" / "machine" / "pbpo_machine.py"
#: Bytes behind the video, and of one request: an upload takes several, and can be cut within them.
PADDING, PIECE = 400_000, 200_000
#: The share of requests that are cut in the middle.
CUT = 0.2


def cut(url: str, token: str, body: bytes, headers: Mapping[str, str]) -> None:
    """Send the first half of a request's body, and hang up."""
    address = urlsplit(url)
    connection = http.client.HTTPConnection(address.netloc, timeout=10)
    connection.putrequest("PUT", f"{address.path}?{address.query}")
    connection.putheader("Authorization", f"Bearer {token}")
    connection.putheader("Content-Length", str(len(body)))
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    connection.send(body[: len(body) // 2])
    connection.close()


def main() -> None:
    url, study, token, video, notes, seconds = sys.argv[1:]
    specification = importlib.util.spec_from_file_location("pbpo_machine", PROGRAM)
    assert specification is not None
    assert specification.loader is not None
    machine: Any = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(machine)
    machine.PIECE, machine.LONGEST_PAUSE_S = PIECE, 1.0
    written = os.open(notes, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    shown = Path(video).read_bytes()

    def note(**said: object) -> None:
        os.write(written, json.dumps(said).encode() + b"\n")

    class Client(machine.Client):  # type: ignore[misc]
        def _call_once(self, method: str, path: str, body: Any, headers: Any) -> Any:
            if method == "PUT" and random.random() < CUT:
                cut(f"{self._base}{path}", token, body, headers)
                raise OSError("the connection was cut")
            return super()._call_once(method, path, body, headers)

        def upload(self, rollout: Any, path: Path) -> Any:
            answer = super().upload(rollout, path)
            note(uploaded=rollout.id, attempt=rollout.attempt, kept=answer["kept"])
            return answer

    def record(_parameters: object, path: Path, rollout: Any) -> dict[str, float]:
        made = shown + (PADDING + 8).to_bytes(4, "big") + b"free" + secrets.token_bytes(PADDING)
        sha256 = hashlib.sha256(made).hexdigest()
        note(begun=rollout.id, attempt=rollout.attempt, sha256=sha256)
        time.sleep(float(seconds))
        path.write_bytes(made)
        return {"score": 1.0}

    machine.Client = Client
    machine.serve(url, study, token, record)


if __name__ == "__main__":
    main()
