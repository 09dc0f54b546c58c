"""Ports for servers that have to be told which, or that come back at the same one."""

from __future__ import annotations

import os
import socket
from itertools import count

#: Below those that the system gives to connections: nobody is given one between two starts. Each
#: process of tests begins at another place.
_FIRST, _LAST = 10_000, 32_000
_tries = count(os.getpid() * 101)


def free_port() -> int:
    """One that nobody listens at now, and that nobody else here is told."""
    while True:
        port = _FIRST + next(_tries) % (_LAST - _FIRST)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
