"""The folder of a reproduction: each finished trial is kept, so that a killed run goes on.

A trial's file appears under its name only when it is whole. Trials made otherwise (another seed,
another engine, other recordings, other settings) are refused, never mixed in.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from app.pbbo import ENGINE_VERSION, PRESETS, SCORE_PRESETS

from .environments import World
from .evaluators import ETA
from .experiments import Task
from .people import PEOPLE
from .steps import Step, StepTableError, from_csv, to_csv


class OtherResultsError(ValueError):
    """A folder holds trials that were made otherwise than those asked for."""


@dataclass(frozen=True)
class Identity:
    """What all trials in a folder have in common."""

    seed: int
    engine_version: str
    settings: str
    recordings: str


def identity(seed: int, worlds: Mapping[str, World]) -> Identity:
    """Of trials run now, with this seed."""
    papers = [
        (name, settings)
        for presets in (PRESETS, SCORE_PRESETS)
        for name, settings in presets.items()
        if name.startswith("paper-")
    ]
    settings = repr((papers, PEOPLE, ETA))
    recordings = " ".join(f"{name}:{world.digest()}" for name, world in sorted(worlds.items()))
    digest = hashlib.sha256(settings.encode()).hexdigest()[:16]
    return Identity(seed, ENGINE_VERSION, digest, recordings)


class Store:
    """Finished trials, below one folder."""

    def __init__(self, folder: Path, made: Identity) -> None:
        self._folder = folder
        self._trials = folder / "trials"
        self._trials.mkdir(parents=True, exist_ok=True)
        manifest = folder / "run.json"
        if manifest.is_file():
            _require_same(folder, _read(manifest), asdict(made))
        else:
            write_whole(manifest, (json.dumps(asdict(made), indent=2) + "\n").encode())

    @property
    def folder(self) -> Path:
        """Where everything of the reproduction goes."""
        return self._folder

    def keep(self, task: Task, steps: Iterable[Step]) -> None:
        """Keep a finished trial."""
        write_whole(self._path(task), to_csv(steps).encode())

    def find(self, task: Task) -> list[Step] | None:
        """The steps of a trial, or None where it was not finished, or not as it is asked for."""
        try:
            steps = from_csv(self._path(task).read_text(encoding="utf-8"))
        except (FileNotFoundError, StepTableError):
            return None
        as_asked = len(steps) == task.steps and {step.seed for step in steps} == {task.seed}
        return steps if as_asked else None

    def _path(self, task: Task) -> Path:
        return self._trials / f"{task.name}.csv"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that is there whole or not at all."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def _read(manifest: Path) -> dict[str, object]:
    try:
        held = json.loads(manifest.read_text(encoding="utf-8"))
    except ValueError:
        held = None
    if not isinstance(held, dict):
        raise OtherResultsError(f"{manifest}: expected the record of a reproduction, got no such")
    return held


def _require_same(folder: Path, held: Mapping[str, object], wanted: Mapping[str, object]) -> None:
    for name, value in wanted.items():
        if held.get(name) != value:
            raise OtherResultsError(
                f"{folder} holds trials of another reproduction ({name}: expected {value!r}, "
                f"got {held.get(name)!r}); name another folder"
            )
