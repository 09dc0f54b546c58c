"""Prometheus metrics of a server.

The metrics are about the server only; no label contains an id or an address of a person. With
several worker processes (PROMETHEUS_MULTIPROC_DIR is set then), each writes its own values to that
folder, and the process that answers a scrape reads those of all.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.multiprocess import MultiProcessCollector

#: Environment variable of prometheus_client: the folder that several processes share.
SHARED_DIR = "PROMETHEUS_MULTIPROC_DIR"

#: Buckets in seconds, around the limits of perception: 100 ms is instant, 1 s is a wait.
_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


#: Name, help text and labels of the gauge of the render queue.
RENDER_QUEUE = (
    "pbpo_render_queue",
    "Videos that wait to be rendered, and those that are being rendered.",
    ["state"],
)


class Metrics:
    """Counters, histograms and gauges of one server.

    own_queue: whether this server renders videos itself, and so reports the render queue.
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
        # With several processes, the first value opens the file that later ones are written to. The
        # files could not be opened after the folder's owner was killed and the folder deleted.
        for worked_out in ("ahead", "at once"):
            self._steps.labels(worked_out)
        self.renders(0, 0)

    @contextmanager
    def answering(self, response: str) -> Iterator[None]:
        """Measure the handling of a response; one that raises an error is not counted."""
        begun = time.perf_counter()
        yield
        self._answering.observe(time.perf_counter() - begun)
        self._responses.labels(response).inc()

    def step_asked(self, *, ahead: bool) -> None:
        """Count a request for the next query. ahead: whether it was precomputed."""
        self._steps.labels("ahead" if ahead else "at once").inc()

    @contextmanager
    def fitting(self, steps: int) -> Iterator[None]:
        """Observe the duration of a batch of `steps` fits as an equal share for each."""
        begun = time.perf_counter()
        yield
        share = (time.perf_counter() - begun) / steps
        for _ in range(steps):
            self._fit.observe(share)

    def renders(self, waiting: int, running: int) -> None:
        """Set the numbers of videos that wait to be rendered and that are being rendered."""
        if self._renders is None:
            return
        self._renders.labels("waiting").set(waiting)
        self._renders.labels("running").set(running)

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """Observe the duration of a request. route: the path's pattern, never the path itself."""
        self._requests.labels(method, route, str(status)).observe(seconds)

    def as_text(self) -> bytes:
        """All metrics in Prometheus's text format."""
        if SHARED_DIR in os.environ:
            registry = CollectorRegistry()
            MultiProcessCollector(registry)  # type: ignore[no-untyped-call]
            return generate_latest(registry)
        return generate_latest(self._registry)
