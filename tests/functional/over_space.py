"""A study over ranges with a scripted machine, whose videos come into being as people choose."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from sqlalchemy import select

from app.services.context import AppContext
from app.services.recordings.recordings import file_locator
from app.services.rollouts import outcomes, states
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from app.storage.models.rollouts import Rollout
from tests.conftest import write_study

from .client import Api, Session
from .own_study import write_video

PLAN = """
version: 1
slug: live
title: Live
languages: [en]
parameters:
  - {name: w0, unit: s, min: 0, max: 1}
  - {name: w1, unit: s, min: 0, max: 1}
constraints: [w0 >= w1]
environments:
  env1: {source: {SOURCE}, rollout: {ROLLOUT}}
conditions:
  - name: threshold
    method: pbpo-threshold
    environment: env1
    skip: {label: Neither}
    settings: {threshold_covering: 2}
trials_per_condition: 1
queries_per_trial: 6
break_s: 0
"""

Parameters = dict[str, float]


class ScriptedMachine:
    """Records what is asked, when it is told to, as a machine's calls would.

    finish: waits until the work in the background is done.
    """

    def __init__(self, app: AppContext, folder: Path, finish: Callable[[], None]) -> None:
        self._app = app
        self._finish = finish
        self._folder = folder
        self.seen: list[Parameters] = []

    def asked(self) -> list[Rollout]:
        """The rollouts that wait for a machine, in the order in which they would be claimed."""
        self._finish()
        with self._app.database.read() as db:
            return list(
                db.scalars(
                    select(Rollout)
                    .where(Rollout.status == states.ASKED)
                    .order_by(Rollout.priority, Rollout.asked_at, Rollout.id)
                )
            )

    def run(
        self, most: int = 100, becomes: Callable[[Parameters], str] = lambda _: "recorded"
    ) -> int:
        """Run what is asked, at most so many; returns how many. becomes: the outcome."""
        number = 0
        for rollout in self.asked()[:most]:
            number += 1
            with self._app.database.write() as db:
                row = outcomes.locked(db, rollout.study_id, rollout.public_id)
                parameters = dict(row.candidate.parameters)
                self.seen.append(parameters)
                row.status, row.claimed_at = states.CLAIMED, self._app.now()
                row.attempt += 1
                match becomes(parameters):
                    case "recorded":
                        outcomes.record(db, row, self._made(), None, self._app.now())
                    case "unsafe":
                        outcomes.mark_unsafe(row, None, "hit the wall", self._app.now())
                    case _:
                        outcomes.fail(
                            db,
                            row,
                            machine=None,
                            reason="motor is cold",
                            attempts=1,
                            now=self._app.now(),
                        )
        return number

    def _made(self) -> outcomes.Made:
        video = self._folder / f"{len(self.seen)}.mp4"
        write_video(video, len(self.seen) % 250)
        sha256 = hashlib.sha256(video.read_bytes()).hexdigest()
        locator = file_locator(sha256, "mp4")
        self._app.recordings.keep_files({locator: video})
        return outcomes.Made(locator, sha256, 0.4)


def open_live_study(
    app: AppContext,
    folder: Path,
    *,
    rollout: str = "{}",
    more: str = "",
    queries: int = 6,
    source: str = "machine",
) -> StudyInfo:
    """The open study.

    rollout: its settings of rollouts, as YAML. more: further lines of its plan.
    """
    plan = PLAN.replace("{ROLLOUT}", rollout).replace("{SOURCE}", source) + more
    plan = plan.replace("queries_per_trial: 6", f"queries_per_trial: {queries}")
    write_study(folder, plan)
    repository.create(app, repository.load_folder(str(folder)))
    return repository.open_study(app, "live")


def wait_for_pair(person: Session, machine: ScriptedMachine) -> None:
    """Let the machine work until the pair of the person is there."""
    for _ in range(20):
        person.look()
        if person.state.get("query") is not None or person.state["stage"] != "query":
            return
        assert person.state["waiting"]["since"]
        assert machine.run() > 0
    raise AssertionError("the pair did not come")


def to_first_pair(client: Api, machine: ScriptedMachine) -> Session:
    """A new session with its first pair on the screen."""
    person = client.start("live")
    person.consent()
    while person.state["stage"] != "query":
        assert person.go_on().status_code == 200
    wait_for_pair(person, machine)
    return person
