"""Where trials run: in this process, in several, or on the machines of a Dask or Ray cluster.

joblib hands them out; dask and ray are optional extras, imported when they are asked for. A result
comes back to the process that asked, which alone writes files.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any, Literal, TypeVar, get_args

import joblib

from .environments import World
from .experiments import Task
from .steps import Step
from .trials import run_trial

Result = TypeVar("Result")

Engine = Literal["local", "dask", "ray"]
ENGINES: tuple[Engine, ...] = get_args(Engine)

#: Workers without work leave after so long; those of a run that was killed have none any more.
WORKER_PATIENCE_S = 60


class EngineError(ValueError):
    """An engine that is not known, or not installed."""


def run_all(
    tasks: Iterable[Task], worlds: Mapping[str, World], *, engine: Engine = "local", jobs: int = 1
) -> Iterator[tuple[Task, list[Step]]]:
    """Run trials, `jobs` at a time; each comes back when it is done, in any order."""
    calls = ((task, worlds[task.environment]) for task in tasks)
    yield from run_each(_run, calls, engine=engine, jobs=jobs)


def run_each(
    function: Callable[..., Result],
    calls: Iterable[tuple[Any, ...]],
    *,
    engine: Engine = "local",
    jobs: int = 1,
) -> Iterator[Result]:
    """function(*arguments) for each of the calls, `jobs` at a time, in any order."""
    if jobs < 1:
        raise EngineError(f"jobs: expected a number from 1 on, got {jobs!r}")
    with _workers(engine, jobs):
        # One trial takes a second or so: handing them out singly costs little, and a run that is
        # killed loses no more than the trials under way.
        parallel = joblib.Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        yield from parallel(joblib.delayed(function)(*arguments) for arguments in calls)


def _run(task: Task, world: World) -> tuple[Task, list[Step]]:
    return task, run_trial(task, world)


def _workers(engine: Engine, jobs: int) -> AbstractContextManager[None]:
    match engine:
        case "local":
            return _local()
        case "dask":
            return _dask(jobs)
        case "ray":
            return _ray(jobs)
        case _:
            raise EngineError(f"engine: expected one of {', '.join(ENGINES)}, got {engine!r}")


@contextmanager
def _local() -> Iterator[None]:
    with joblib.parallel_config("loky", idle_worker_timeout=WORKER_PATIENCE_S):
        yield


@contextmanager
def _dask(jobs: int) -> Iterator[None]:
    """A Dask cluster: the one of DASK_SCHEDULER_ADDRESS, or else `jobs` workers on this machine."""
    dask, distributed = _optional("dask", "dask"), _optional("distributed", "dask")
    with ExitStack() as stack:
        address = dask.config.get("scheduler-address", None)
        if address is None:
            address = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=jobs, threads_per_worker=1, dashboard_address=None
                )
            )
        stack.enter_context(distributed.Client(address))
        stack.enter_context(joblib.parallel_config("dask", wait_for_workers_timeout=60))
        yield


@contextmanager
def _ray(jobs: int) -> Iterator[None]:
    """A Ray cluster: the one of RAY_ADDRESS, or else `jobs` workers on this machine."""
    ray, ray_joblib = _optional("ray", "ray"), _optional("ray.util.joblib", "ray")
    if "RAY_ADDRESS" in os.environ:
        ray.init()
    else:
        ray.init(num_cpus=jobs, include_dashboard=False)
    try:
        ray_joblib.register_ray()
        with joblib.parallel_config("ray"):
            yield
    finally:
        ray.shutdown()


def _optional(module: str, extra: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise EngineError(
            f"engine: expected {extra} to be installed (pip install 'pbpo-studio[{extra}]'), "
            f"got: {error}"
        ) from error
