"""A study over ranges with machines of its own processes, and what they were told."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import func, select

from app.services.background.local import LocalBackground
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.rollouts import machines, states
from app.services.runtime.settings import Settings
from app.services.studies import repository
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import Recording
from tests.conftest import write_study
from tests.functional.machine_study import video_bytes
from tests.functional.over_space import PLAN

STUDY = "live"


@dataclass
class Fleet:
    """Machines of the study, each a process that can be killed and begun again.

    run_s: seconds that a run takes.
    """

    url: str
    tokens: list[str]
    folder: Path
    run_s: float
    _processes: dict[int, subprocess.Popen[bytes]] = field(default_factory=dict)

    def begin(self, number: int) -> None:
        """Begin this machine."""
        words = [self.url, STUDY, self.tokens[number], self._video, self._notes, str(self.run_s)]
        self._processes[number] = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("machine.py"), *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def kill(self, number: int) -> None:
        """As a power cut would."""
        process = self._processes.pop(number)
        process.kill()
        process.wait()

    def notes(self) -> list[dict[str, Any]]:
        """What the machines wrote down."""
        if not Path(self._notes).exists():
            return []
        return [json.loads(line) for line in Path(self._notes).read_text().splitlines()]

    @property
    def _notes(self) -> str:
        return str(self.folder / "notes.jsonl")

    @property
    def _video(self) -> str:
        path = self.folder / "run.mp4"
        if not path.exists():
            path.write_bytes(video_bytes())
        return str(path)


def open_machine_study(
    settings: Settings,
    folder: Path,
    number: int,
    *,
    rollout: str,
    queries: int = 10,
    slug: str = STUDY,
) -> list[str]:
    """Open the study, with so many machines; their tokens. rollout: its settings, as YAML."""
    plan = PLAN.replace("{ROLLOUT}", rollout).replace("{SOURCE}", "machine")
    plan = plan.replace(f"slug: {STUDY}", f"slug: {slug}")
    plan = plan.replace("queries_per_trial: 6", f"queries_per_trial: {queries}")
    write_study(folder / "study", plan)
    app = open_app(settings, background=LocalBackground(1))
    try:
        repository.create(app, repository.load_folder(str(folder / "study")))
        repository.open_study(app, slug)
        return [machines.add(app, slug, f"machine-{one}") for one in range(number)]
    finally:
        app.close()


@contextmanager
def working(fleet: Fleet) -> Iterator[None]:
    """All machines of the fleet at work during the block."""
    for number in range(len(fleet.tokens)):
        fleet.begin(number)
    try:
        yield
    finally:
        for number in range(len(fleet.tokens)):
            fleet.kill(number)


def faults_in(app: AppContext, notes: Sequence[dict[str, Any]]) -> list[str]:
    """A sentence for each promise to machines that was not kept; none if all were."""
    begun: dict[tuple[str, int], list[str]] = defaultdict(list)
    for one in notes:
        if "begun" in one:
            begun[one["begun"], one["attempt"]].append(one["sha256"])
    with app.database.read() as db:
        rollouts = {one.public_id: one for one in db.scalars(select(Rollout))}
        recordings = db.scalar(select(func.count(Recording.id)))
    recorded = [one for one in rollouts.values() if one.status == states.RECORDED]
    found = [
        f"attempt {attempt} of {rollout} was given to {len(runs)} machines"
        for (rollout, attempt), runs in begun.items()
        if len(runs) > 1
    ]
    for one in notes:
        made = begun.get((one.get("uploaded", ""), one["attempt"]), [])
        if one.get("kept") and rollouts[one["uploaded"]].sha256 not in made:
            found.append(f"a recording of {one['uploaded']} was acknowledged and is not stored")
    made_of = defaultdict(set)
    for (rollout, _), runs in begun.items():
        made_of[rollout].update(runs)
    found += [
        f"{one.public_id} has a recording that no machine made for it"
        for one in recorded
        if one.sha256 not in made_of[one.public_id]
    ]
    if recordings != len(recorded):
        found.append(f"{len(recorded)} rollouts are recorded, and there are {recordings} videos")
    if len({one.candidate_id for one in recorded}) < len(recorded):
        found.append("some parameters were recorded twice")
    lost = [one for one in rollouts.values() if one.status == states.FAILED]
    if lost:
        found.append(f"{len(lost)} rollouts have failed: {lost[0].explanation}")
    return found
