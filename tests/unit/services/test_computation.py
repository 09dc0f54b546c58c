"""Thinking in another process: the same thoughts, and nothing that a dead process could hold up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import psutil
import pytest

from app.services.proposals.computation import FitProcess, StepRequest, compute_step

QUESTION = StepRequest(
    candidates=np.linspace(0, 1, 9)[:, None],
    method="pbpo",
    settings={"preset": "paper-env1", "random_queries": 2},
    seed=5,
    history=((0, 4, "left"), (2, 8, "skip"), (1, 4, "right")),
    ends=False,
)


@pytest.fixture
def elsewhere() -> Iterator[FitProcess]:
    opened = FitProcess()
    yield opened
    opened.close()


def workers() -> set[psutil.Process]:
    # Children are forked by a process that is a child itself.
    here = psutil.Process()
    return {child for child in here.children(recursive=True) if child.ppid() != here.pid}


def test_the_same_is_thought_here_and_elsewhere_also_after_a_killed_process(
    elsewhere: FitProcess,
) -> None:
    here = compute_step(QUESTION)
    before = workers()
    # Whoever cannot wait for a process to start asks first whether it is there.
    assert not elsewhere.is_ready
    assert elsewhere.compute_steps([QUESTION]) == [here]
    assert elsewhere.is_ready
    (process,) = workers() - before
    process.kill()
    process.wait(10)
    assert elsewhere.compute_steps([QUESTION]) == [here]
