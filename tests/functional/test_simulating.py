"""Simulated sessions from the page, and what they tell of a design."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sqlalchemy import select

from app import simulated_recordings
from app.crane import single_run
from app.lab.people_needed import Found, sweep
from app.lab.session_people import SimulatedPeople
from app.services.accounts import audit_log
from app.services.accounts.accounts import Role
from app.services.background.interface import Background
from app.services.background.job_function import JobHandler
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.sessions.replay import replay
from app.services.studies import repository, simulation_results
from app.services.studies.repository import StudyInfo
from app.simulation import JOBS, completed_simulated, run, simulate_job
from app.storage.models.rollouts import Rollout
from app.storage.models.studies import SessionRow

from .client import Api
from .desk import Desk
from .machine_study import video_bytes
from .over_space import open_live_study
from .own_study import RECORDINGS, write_own_study
from .test_crane_machine import AtOnce as RendersAtOnce
from .test_jobs import AtOnce


@pytest.fixture
def background() -> Background:
    return AtOnce(1)


@pytest.fixture
def job_handlers() -> Mapping[str, JobHandler]:
    return JOBS


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


@pytest.fixture
def kettles(desk: Desk, app: AppContext, tmp_path: Path) -> StudyInfo:
    folder = write_own_study(tmp_path / "kettles")
    table = RECORDINGS.replace("videos/b.mp4,", "videos/b.mp4,-4")
    (folder / "recordings.csv").write_text(table)
    loaded = repository.load_folder(str(folder))
    return repository.create(app, loaded, desk.account.account_id)


def simulate(desk: Desk, sessions: int = 3, **more: str) -> None:
    form = {"sessions": str(sessions), "evaluator": "certain", "seed": "1", **more}
    assert desk.post("/studies/kettles/simulate", **form).status_code == 303


def test_simulated_sessions_fill_a_drafts_tables_and_tell_of_its_design(
    desk: Desk, app: AppContext, kettles: StudyInfo
) -> None:
    before = desk.get("/studies/kettles/manage").text
    assert 'data-testid="simulate"' in before
    assert 'data-testid="regrets"' not in before
    simulate(desk)
    page = desk.get("/studies/kettles/manage").text
    assert "3 simulated sessions were completed." in page
    assert "From 3 simulated sessions" in page
    assert "last one wins less with skip" in page
    with app.database.read() as db:
        rows = db.execute(select(SessionRow.mode, SessionRow.stage)).all()
    assert [tuple(row) for row in rows] == [("simulated", "completed")] * 3
    assert audit_log.trail(app, "kettles")[0].action == "simulation asked for"


def test_the_page_tells_how_many_people_are_needed(desk: Desk, kettles: StudyInfo) -> None:
    form = {"people": "2, 3", "answers": "2", "own_share": "0.3", "within": "0.9", "sets": "2"}
    refused = desk.post("/studies/kettles/power", **form | {"answers": "2; 1"})
    assert "whole numbers from 1 to 50 with commas between them" in refused.text
    assert desk.post("/studies/kettles/power", **form, seed="0").status_code == 303
    page = desk.get("/studies/kettles/manage").text
    assert page.count("2 people of 2 answers are enough.") == 3
    shown = re.search(r'data-testid="power-lines".*?</table>', page, re.DOTALL)
    assert shown is not None
    found = list(sweep([2, 3], [2], 0.3, [0, 1]))
    cells = re.findall(r"<td[^>]*>(.*?)</td>", shown[0])
    assert cells == [
        str(value)
        for one in found
        for value in (
            one.people,
            one.answers,
            *(f"{np.mean(way):.3f} ± {np.std(way, ddof=1) / 2**0.5:.3f}" for way in ways(one)),
        )
    ]


def ways(found: Found) -> tuple[tuple[float, ...], ...]:
    return found.shared, found.pooled, found.own


def test_the_design_is_worked_out_from_what_was_acquired(
    desk: Desk, app: AppContext, kettles: StudyInfo
) -> None:
    assert simulation_results.designs(app, kettles) == []
    simulate(desk, 4)
    [found] = simulation_results.designs(app, kettles)
    assert (found.evaluator, found.sessions) == ("certain", 4)
    assert [(line.condition, line.query) for line in found.regrets] == [
        (name, query) for name in ("with skip", "last one wins") for query in (1, 3, 4)
    ]
    # The best candidate scores 2, the worst -10: nobody is further from the best than 12.
    assert all(0 <= line.regret.mean <= 12 for line in found.regrets)
    assert all(line.regret.n == 4 for line in found.regrets)
    # Of three candidates, a knockout that is always right has the best after a few queries.
    knockout = [line.regret.mean for line in found.regrets if line.condition == "last one wins"]
    assert knockout == sorted(knockout, reverse=True)
    [contrast] = found.contrasts
    assert (contrast.first, contrast.second) == ("with skip", "last one wins")
    assert all(1 <= query <= 4 for query in found.queries_enough.values())


def test_kinds_of_evaluators_are_told_apart_and_exported(
    desk: Desk, app: AppContext, kettles: StudyInfo
) -> None:
    simulate(desk, 2)
    simulate(desk, 3, evaluator="uncertain", seed="7")
    certain, uncertain = simulation_results.designs(app, kettles)
    assert (certain.evaluator, certain.sessions) == ("certain", 2)
    assert uncertain.evaluator.startswith("uncertain, eta ")
    assert uncertain.sessions == 3
    page = desk.get("/studies/kettles/manage").text
    assert "From 2 simulated sessions (evaluator: certain)" in page
    assert "From 3 simulated sessions (evaluator: uncertain, eta " in page
    sessions = pd.read_csv(
        io.StringIO(desk.get("/api/v1/studies/kettles/export/sessions.csv?mode=simulated").text)
    )
    assert list(sessions["evaluator"]) == ["certain"] * 2 + ["uncertain"] * 3
    assert list(sessions["evaluator_seed"]) == [1, 1, 7, 7, 7]
    settings = [json.loads(said) for said in sessions["evaluator_settings"]]
    assert [said["index"] for said in settings] == [0, 1, 0, 1, 2]
    assert "eta" not in settings[0]
    scores = np.array([-3.5, -4.0, -10.0, 2.0])
    assert settings[0]["skip_below"] == pytest.approx(scores.mean())
    assert settings[4]["equal_within"] == pytest.approx(6 / 23.4 * scores.std())
    assert settings[4]["eta"] == pytest.approx(0.08 * 23.4 / scores.std())


def test_people_with_tastes_of_their_own_walk_through_a_study(
    desk: Desk, app: AppContext, kettles: StudyInfo
) -> None:
    people = SimulatedPeople(3, 0.5, ("one-sided",))
    done = run(app.settings, "kettles", 3, "certain", 7, people=people)
    assert "50% of the variance of their taste was their own" in done.in_words()
    assert "Not reliable were: one-sided." in done.in_words()
    [found] = simulation_results.designs(app, kettles)
    assert found.evaluator == "people, 50% of their taste their own"
    queries, sessions = (
        pd.read_csv(
            io.StringIO(desk.get(f"/api/v1/studies/kettles/export/{name}.csv?mode=simulated").text)
        )
        for name in ("queries", "sessions")
    )
    settings = [json.loads(said) for said in sessions["evaluator_settings"]]
    assert [said["person"] for said in settings] == ["honest", "honest", "one-sided"]
    assert len({said["noise"] for said in settings}) == 3
    assert list(sessions["evaluator_seed"]) == [7, 7, 7]
    last = queries[queries["session_id"] == sessions["session_id"].iloc[-1]]
    assert set(last["response"]) == {"left"}


def test_without_synthesis_a_skip_says_that_a_choice_is_hard(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    plan = folder / "study.yaml"
    plan.write_text(plan.read_text().replace("method: pbpo\n", "method: pbpo-no-synthesis\n"))
    # Two nearly equal and good, one bad.
    table = RECORDINGS.replace("videos/b.mp4,", "videos/b.mp4,1.9").replace("-3.5", "1.8")
    (folder / "recordings.csv").write_text(table)
    repository.create(app, repository.load_folder(str(folder)), desk.account.account_id)
    simulate(desk, 4)
    queries, recordings = (
        pd.read_csv(
            io.StringIO(desk.get(f"/api/v1/studies/kettles/export/{name}.csv?mode=simulated").text)
        )
        for name in ("queries", "recordings")
    )
    score = dict(zip(recordings["recording"], recordings["score"], strict=True))
    offered = queries[queries["method"] == "pbpo-no-synthesis"]
    pairs = zip(offered["left_recording"], offered["right_recording"], strict=True)
    close = [abs(score[left] - score[right]) < 1 for left, right in pairs]
    assert list(offered["response"] == "skip") == close
    assert any(close)


def test_the_length_of_a_session_is_the_sum_of_its_parts(
    app: AppContext, kettles: StudyInfo
) -> None:
    found = simulation_results.duration(app, kettles)
    assert found is not None
    assert (found.pairs, found.breaks_s) == (8, 0)
    assert found.video_s == pytest.approx(0.4)
    assert found.total_s == pytest.approx(
        simulation_results.READING_S + 8 * (0.4 + simulation_results.THINKING_S)
    )


def test_a_simulation_begun_again_makes_only_what_is_missing(
    desk: Desk, app: AppContext, kettles: StudyInfo
) -> None:
    simulate(desk, 2)
    request = {
        "slug": "kettles",
        "sessions": 3,
        "evaluator": "uncertain",
        "seed": 0,
        "before": 0,
    }
    said = simulate_job(app.settings, request, lambda *_: None)
    assert said.startswith("3 simulated sessions were completed.")
    assert "steepness" in said
    assert completed_simulated(app.settings, "kettles") == 3


def test_what_cannot_be_simulated_is_refused_in_a_sentence(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    loaded = repository.load_folder(str(write_own_study(tmp_path / "kettles")))
    repository.create(app, loaded, desk.account.account_id)
    form = {"sessions": "3", "evaluator": "certain"}
    refused = desk.post("/studies/kettles/simulate", **form)
    assert refused.status_code == 409
    assert "a score for every recording" in refused.text
    for wrong in ({"sessions": "0"}, {"sessions": "9999"}, {"evaluator": "nobody"}, {"seed": "-1"}):
        assert desk.post("/studies/kettles/simulate", **{**form, **wrong}).status_code == 422


def test_the_crane_records_what_simulated_evaluators_choose_among(
    app: AppContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seen(_environment: str, point: tuple[float, float], _seed: int, path: Path) -> object:
        path.write_bytes(video_bytes())
        return single_run.RecordedRun(-100 * abs(point[0] - 0.6), (0.0,))

    monkeypatch.setattr(single_run, "record", seen)
    monkeypatch.setattr(simulated_recordings, "LocalBackground", RendersAtOnce)
    live = open_live_study(app, tmp_path / "study", source="machine crane", queries=3)
    done = run(app.settings, "live", 1, "certain", 0)
    assert done.completed == 1
    # The published runs of the crane are the scale, since nothing was recorded before.
    assert "when both scores lay below -69" in done.in_words()
    with app.database.read() as db:
        rollouts = db.scalars(select(Rollout)).all()
        evaluator = db.scalars(select(SessionRow.evaluator)).one()
    assert {one.status for one in rollouts} == {"recorded"}
    # Two for the first pair, one for each that follows, and none that was not looked at.
    assert len(rollouts) == 4
    assert evaluator is not None
    assert evaluator["skip_below"] == done.habits.skip_below
    assert [trial.differences for trial in replay(app, "live")] == [()]
    assert simulation_results.designs(app, live) == []


def test_a_simulation_waits_for_a_machine_and_says_when_there_is_none(
    app: AppContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_recordings, "MACHINE_MISSED_S", 0.1)
    open_live_study(app, tmp_path / "study")
    with pytest.raises(ConflictError, match="none has been connected"):
        run(app.settings, "live", 1, "uncertain", 0)
