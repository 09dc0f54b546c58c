"""Connections that never complete a request."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn

from app import server
from app.services.runtime.settings import Settings
from app.web.http import connection_limits

HEAD = b"GET / HTTP/1.1\r\nHost: a\r\n"
CHUNKED = b"POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n"


async def answer(scope: Any, receive: Any, send: Any) -> None:
    size = 0
    while True:
        message = await receive()
        size += len(message.get("body", b""))
        if not message.get("more_body"):
            break
    headers = [(b"content-length", str(len(str(size))).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": str(size).encode()})


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    """A server with the configuration of `pbpo serve`."""
    config = server._config(answer, Settings(data_dir=tmp_path), lifespan="off")
    running = uvicorn.Server(config)
    listening = socket.create_server(("127.0.0.1", 0))
    thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]})
    thread.start()
    yield listening.getsockname()[1]
    running.should_exit = True
    thread.join(10)


def bytes_taken(port: int, first: bytes, part: bytes, most: int) -> int:
    """How much the server takes before it closes the connection."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
        sent = len(first)
        try:
            client.sendall(first)
            while sent < most:
                client.sendall(part)
                sent += len(part)
        except OSError:
            pass
        return sent


@pytest.mark.parametrize(
    ("first", "part"),
    [
        (HEAD, b"X: y\r\n" * 1_000),
        (HEAD + b"X: ", b"x" * 10_000),
        (b"GET /", b"x" * 10_000),
        (CHUNKED, b"1;" + b"x" * 10_000 + b"\r\n \r\n"),
        (CHUNKED + b"0\r\n", b"X: y\r\n" * 1_000),
    ],
)
def test_a_request_that_does_not_end_is_cut_off(port: int, first: bytes, part: bytes) -> None:
    most = 60_000_000
    assert bytes_taken(port, first, part, most) < most


def test_headers_that_do_not_come_end_the_connection(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_limits, "HEADERS_WITHIN_S", 0.5)
    for sent in (b"", b"GET / HT"):
        with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
            client.sendall(sent)
            assert client.recv(10) == b""


def test_bodies_are_taken_whatever_their_size_and_their_chunks(port: int) -> None:
    address = f"http://127.0.0.1:{port}/"
    with httpx.Client() as client:
        assert client.post(address, content=b"x" * 5_000_000).text == "5000000"
        chunks = (b"x" for _ in range(100_000))
        assert client.post(address, content=chunks, timeout=60).text == "100000"
        for _ in range(20):
            assert client.get(address, headers={"x": "y" * 30_000}).text == "0"


def test_a_slow_answer_is_waited_for(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_limits, "HEADERS_WITHIN_S", 0.5)
    with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
        client.sendall(b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 2\r\n\r\nx")
        time.sleep(1)
        client.sendall(b"x")
        assert client.recv(15) == b"HTTP/1.1 200 OK"
