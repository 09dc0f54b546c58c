"""What a running server measures of itself, in the form that Prometheus reads.

Every number is of what the server does. None is of a person: no label holds an id or an address.
With several worker processes (PROMETHEUS_MULTIPROC_DIR is set then) each writes its own, and
whichever is asked answers for all of them.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.multiprocess import MultiProcessCollector

#: Where several worker processes lay down what they count: the client's own name for it.
SHARED_DIR = "PROMETHEUS_MULTIPROC_DIR"

#: Around what a person notices: 100 ms is at once, a second is a wait.
_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


#: Name, meaning and label of the gauge of videos that are made.
RENDER_QUEUE = (
    "pbpo_render_queue",
    "Videos that wait to be rendered, and those that are being rendered.",
    ["state"],
)


class Metrics:
    """Counters, durations and gauges of one studio.

    own_queue: whether the studio renders videos itself, and counts them.
    """

    def __init__(self, *, own_queue: bool = True) -> None:
        registry = CollectorRegistry()
        self._registry = registry
        self._responses = Counter(
            "pbpo_responses",
            "Responses that were taken, repetitions of the same one included.",
            ["response"],
            registry=registry,
        )
        self._answering = Histogram(
            "pbpo_response_to_next_query_seconds",
            "From a response's arrival until the next query is known and stored.",
            buckets=_SECONDS,
            registry=registry,
        )
        self._steps = Counter(
            "pbpo_steps_asked",
            "Next queries that were asked for, by whether they had been worked out ahead.",
            ["worked_out"],
            registry=registry,
        )
        self._fit = Histogram(
            "pbpo_fit_seconds",
            "Working out what follows one history: the model's fit and the next query.",
            buckets=_SECONDS,
            registry=registry,
        )
        self._renders = (
            Gauge(*RENDER_QUEUE, multiprocess_mode="livesum", registry=registry)
            if own_queue
            else None
        )
        self._requests = Histogram(
            "pbpo_http_request_seconds",
            "From a request's arrival until its answer begins.",
            ["method", "route", "status"],
            buckets=_SECONDS,
            registry=registry,
        )
        # With several processes these open the files that all that follows is written to: where
        # the folder has gone, since the process that made it was killed, none could be opened.
        for worked_out in ("ahead", "at once"):
            self._steps.labels(worked_out)
        self.renders(0, 0)

    @contextmanager
    def answering(self, response: str) -> Iterator[None]:
        """Within this, a response is taken; one that is refused is not counted."""
        begun = time.perf_counter()
        yield
        self._answering.observe(time.perf_counter() - begun)
        self._responses.labels(response).inc()

    def step_asked(self, *, ahead: bool) -> None:
        """Somebody waits for a next query, which was worked out ahead or not."""
        self._steps.labels("ahead" if ahead else "at once").inc()

    @contextmanager
    def fitting(self, steps: int) -> Iterator[None]:
        """Within this, so many steps are worked out: each is said to have taken its share."""
        begun = time.perf_counter()
        yield
        share = (time.perf_counter() - begun) / steps
        for _ in range(steps):
            self._fit.observe(share)

    def renders(self, waiting: int, running: int) -> None:
        """How many videos wait to be rendered, and how many are being rendered."""
        if self._renders is None:
            return
        self._renders.labels("waiting").set(waiting)
        self._renders.labels("running").set(running)

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """A request was answered; `route` is the path's pattern, never the path itself."""
        self._requests.labels(method, route, str(status)).observe(seconds)

    def as_text(self) -> bytes:
        """Everything measured, in Prometheus's text format."""
        if SHARED_DIR in os.environ:
            registry = CollectorRegistry()
            MultiProcessCollector(registry)  # type: ignore[no-untyped-call]
            return generate_latest(registry)
        return generate_latest(self._registry)
