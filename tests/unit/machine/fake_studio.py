"""A small server that answers a machine as the studio does, and can fail on purpose."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


class FakeStudio:
    """Rollouts to hand out, and what came back.

    faults: statuses to answer with before anything is done, oldest first; 0 cuts the connection,
    after half of a body was read. hold: called at each heartbeat; whether the lease goes on.
    """

    def __init__(self) -> None:
        self.waiting: list[dict[str, Any]] = []
        self.videos: dict[str, bytearray] = {}
        self.digests: dict[str, str] = {}
        self.reports: list[tuple[str, str, dict[str, Any]]] = []
        self.faults: list[int] = []
        self.beats: list[dict[str, Any]] = []
        self.hold: Callable[[], tuple[int, dict[str, Any]]] = lambda: (200, {"stopped": False})
        self.tokens: set[str] = set()
        studio = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                studio.answer(self)

            do_PUT = do_POST  # noqa: N815

            def log_message(self, *_: Any) -> None:
                return

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def ask(self, name: str, timeout_s: float = 60, **parameters: float) -> None:
        self.waiting.append(
            {
                "id": name,
                "environment": "pit",
                "parameters": parameters,
                "seed": 7,
                "run_index": 0,
                "attempt": 1,
                "reason": "query",
                "timeout_s": timeout_s,
                "lease": {"heartbeat_s": 0.05},
            }
        )

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        self.tokens.add(request.headers["Authorization"])
        length = int(request.headers["Content-Length"])
        fault = self.faults.pop(0) if self.faults else None
        if fault == 0:
            body = request.rfile.read(length // 2)
            if request.command == "PUT":
                self._store(request, body)
            request.connection.close()
            return
        body = request.rfile.read(length)
        if fault is not None:
            self._send(request, fault, {"detail": "not now"})
            return
        path = request.path.partition("?")[0].partition("/rollouts")[2]
        if path == "/claim":
            rollout = self.waiting.pop(0) if self.waiting else None
            self._send(request, 204 if rollout is None else 200, rollout)
            return
        _, name, what = path.split("/")
        if what == "recording":
            self._send(request, *self._store(request, body))
            return
        said = json.loads(body)
        if what == "heartbeat":
            self.beats.append(said)
            self._send(request, *self.hold())
            return
        self.reports.append((name, what, said))
        self._send(request, 200, {"status": "asked"})

    def _store(self, request: BaseHTTPRequestHandler, body: bytes) -> tuple[int, dict[str, Any]]:
        name = request.path.partition("/rollouts/")[2].partition("/")[0]
        at = re.fullmatch(r"bytes (\d+)-(\d+)/(\d+)", request.headers["Content-Range"])
        assert at is not None
        video = self.videos.setdefault(name, bytearray())
        first, total = int(at[1]), int(at[3])
        if first > len(video):
            return 409, {"detail": "bytes are missing", "received": len(video)}
        video[first : first + len(body)] = body
        self.digests[name] = request.headers["Repr-Digest"]
        if len(video) < total:
            return 202, {"received": len(video), "total": total}
        return 201, {"status": "recorded", "kept": True, "detail": ""}

    @staticmethod
    def _send(request: BaseHTTPRequestHandler, status: int, content: Any) -> None:
        data = b"" if content is None else json.dumps(content).encode()
        request.send_response(status)
        request.send_header("Content-Length", str(len(data)))
        request.end_headers()
        request.wfile.write(data)
