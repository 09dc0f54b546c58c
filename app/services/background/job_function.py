"""Types of job handlers and of the callback by which they report progress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from app.services.runtime.settings import Settings

#: Called with the number of finished steps and the total.
ProgressCallback = Callable[[int, int], None]
#: Executes a job: takes the settings, the request and a progress callback, and returns the result
#: as a sentence. It runs in a child process, so it must be an importable function.
JobHandler = Callable[[Settings, Mapping[str, Any], ProgressCallback], str]
