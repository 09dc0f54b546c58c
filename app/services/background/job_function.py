"""What a job is to its doer: what was asked for, and somebody to be told how far it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from app.services.runtime.settings import Settings

#: Told how much of how much is done.
ProgressCallback = Callable[[int, int], None]
#: Work that a job does, by what was asked for; it returns what came of it, in a sentence. It runs
#: in a process of its own, so it is a function that can be imported.
JobHandler = Callable[[Settings, Mapping[str, Any], ProgressCallback], str]
