"""Design analysis from simulated sessions: duration, regret, and the number of people needed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services import jobs
from app.services.accounts import audit_log
from app.services.accounts.accounts import Principal
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.statistics.power import Interval, PeopleNeeded, mean_interval, people_needed
from app.storage.models.studies import Acquired, Candidate, Recording, SessionRow, Trial
from app.study import assignment, planned_tests
from app.study.plan import Plan

from .candidate_scores import mean_scores
from .repository import StudyInfo

#: Assumed time to decide after both videos were seen once, in seconds.
THINKING_S = 4.0
#: Assumed time to read the texts before the first trial, in seconds.
READING_S = 180.0
#: Tolerance for calling a regret as low as the lowest later one, as a fraction of the total gain.
NO_WORSE = 0.1

#: The kind of job that runs simulated sessions of a study.
SIMULATE = "simulate"
#: Limit of the page, whose job would otherwise take hours; the command line has none.
MOST_SESSIONS = 500

#: (session, condition) -> score of the acquired candidate after each query, shape (queries,).
Curves = Mapping[tuple[int, str], list[float]]


@dataclass(frozen=True)
class RegretLine:
    """The regret of a condition after `query` queries: the best score less the acquired one's."""

    condition: str
    query: int
    regret: Interval


@dataclass(frozen=True)
class Contrast:
    """The difference of two conditions' acquired scores, and the number of people to detect it.

    people: for 80 % power in the paired t-test that the results run. None if nothing can be told.
    level: the level of that test.
    """

    first: str
    second: str
    difference: Interval
    people: PeopleNeeded | None
    level: float


@dataclass(frozen=True)
class Design:
    """The analysis of a design from its simulated sessions by one kind of evaluator."""

    evaluator: str
    sessions: int
    regrets: Sequence[RegretLine]
    contrasts: Sequence[Contrast]
    queries_enough: Mapping[str, int]


@dataclass(frozen=True)
class Duration:
    """The estimated length of a session in seconds, and its components."""

    total_s: float
    video_s: float
    pairs: int
    breaks_s: float


def simulate(
    app: AppContext, caller: Principal, study: StudyInfo, sessions: int, kind: str, seed: int
) -> jobs.JobInfo:
    """Enqueue a job of simulated sessions, and return it.

    kind: the kind of simulated evaluator. Raises ConflictError if a recording has no score.
    """
    with app.database.read() as db:
        unscored = db.scalar(
            select(func.count(Recording.id))
            .join(Candidate, Recording.candidate_id == Candidate.id)
            .where(Candidate.study_id == study.id, Recording.score.is_(None))
        )
        before = db.scalar(
            select(func.count(SessionRow.id)).where(
                SessionRow.study_id == study.id,
                SessionRow.mode == "simulated",
                SessionRow.stage == "completed",
            )
        )
    if unscored:
        raise ConflictError(
            "expected a score for every recording, since simulated evaluators answer from them,"
            f" and {unscored} have none"
        )
    request = {
        "slug": study.slug,
        "sessions": sessions,
        "evaluator": kind,
        "seed": seed,
        "before": before or 0,
    }
    asked = jobs.enqueue(app, caller, SIMULATE, request, study.id)
    audit_log.note_alone(
        app, caller.email, "simulation asked for", study.slug, sessions=sessions, evaluator=kind
    )
    return asked


def duration(app: AppContext, study: StudyInfo) -> Duration | None:
    """The estimated duration, from the mean video lengths; None if the study has no videos."""
    on = assignment.conditions_on(study.plan, study.conditions_off)
    plan = assignment.narrowed(study.plan, on)
    with app.database.read() as db:
        lengths: dict[str, float] = {
            environment: float(seconds)
            for environment, seconds in db.execute(
                select(Candidate.environment, func.avg(Recording.duration_s))
                .join(Recording, Recording.candidate_id == Candidate.id)
                .where(Candidate.study_id == study.id)
                .group_by(Candidate.environment)
            )
        }
    if not lengths:
        return None
    video_s = float(np.mean([lengths[condition.environment] for condition in plan.conditions]))
    pairs = plan.trials * plan.shown_per_trial + plan.practice.queries
    blocks = plan.trials // plan.trials_per_block
    breaks_s = float((plan.trials - 1) * plan.break_s)
    watching_s = blocks * plan.familiarisation.required * video_s
    total_s = READING_S + watching_s + pairs * (video_s + THINKING_S) + breaks_s
    return Duration(total_s, video_s, pairs, breaks_s)


def designs(app: AppContext, study: StudyInfo) -> list[Design]:
    """The analyses of the study's completed simulated sessions, one for each kind of evaluator.

    None of a study over ranges: what is acquired there is hardly ever recorded, and has no score.
    """
    if study.plan.has_ranges:
        return []
    with app.database.read() as db:
        scores = mean_scores(db, study.id)
        curves = _curves(db, study.id, scores, ends_early=study.plan.stop is not None)
        kinds = _evaluators(db, study.id)
    by_kind: dict[str, dict[tuple[int, str], list[float]]] = {}
    for (session_id, condition), curve in curves.items():
        by_kind.setdefault(kinds[session_id], {})[session_id, condition] = curve
    return [_design(study, kind, scores, by_kind[kind]) for kind in sorted(by_kind)]


def _design(
    study: StudyInfo, evaluator: str, scores: Mapping[tuple[str, int], float], curves: Curves
) -> Design:
    plan = study.plan
    best: dict[str, float] = {}
    for (where, _), score in scores.items():
        best[where] = max(score, best.get(where, score))
    environment = {one.name: one.environment for one in plan.conditions}
    names = [one.name for one in plan.conditions if any(name == one.name for _, name in curves)]
    regrets = {
        name: best[environment[name]] - np.array([curves[key] for key in curves if key[1] == name])
        for name in names
    }  # each (sessions, queries)
    return Design(
        evaluator=evaluator,
        sessions=len({session_id for session_id, _ in curves}),
        regrets=[
            RegretLine(name, query, mean_interval(regrets[name][:, query - 1].tolist()))
            for name in names
            for query in _steps(regrets[name].shape[1])
        ],
        contrasts=[
            contrast
            for first, second in planned_tests.comparisons(plan)
            if first in names
            and second in names
            and (contrast := _contrast(plan, curves, first, second)) is not None
        ],
        queries_enough={name: _enough(regrets[name].mean(axis=0)) for name in names},
    )


def _contrast(plan: Plan, curves: Curves, first: str, second: str) -> Contrast | None:
    """Compare two conditions' final scores, second less first, within sessions that have both."""
    sessions = {session_id for session_id, name in curves if name == first}
    differences = [
        curves[session_id, second][-1] - curves[session_id, first][-1]
        for session_id in sorted(sessions)
        if (session_id, second) in curves
    ]
    if not differences:
        return None
    level = planned_tests.strictest_level(plan, first, second)
    needed = people_needed(differences, alpha=level)
    return Contrast(first, second, mean_interval(differences), needed, level)


def evaluator_label(evaluator: Mapping[str, Any] | None) -> str:
    """The kind of an evaluator with the settings that tell it from others of its kind."""
    if evaluator is None:
        return "not recorded"
    if "own_share" in evaluator:
        return f"{evaluator['kind']}, {evaluator['own_share']:.0%} of their taste their own"
    eta = evaluator.get("eta")
    return f"{evaluator['kind']}, eta {eta:.4g}" if eta is not None else str(evaluator["kind"])


def _evaluators(db: Session, study_id: int) -> dict[int, str]:
    """The kind of evaluator of each simulated session, by primary key."""
    statement = select(SessionRow.id, SessionRow.evaluator).where(
        SessionRow.study_id == study_id, SessionRow.mode == "simulated"
    )
    return {
        session_id: evaluator_label(evaluator) for session_id, evaluator in db.execute(statement)
    }


def _enough(mean_regret: NDArray[np.float64]) -> int:
    """The first query after which the mean regret, of shape (queries,), hardly decreases."""
    lowest_yet_to_come = np.minimum.accumulate(mean_regret[::-1])[::-1]
    gained = float(mean_regret[0] - mean_regret.min())
    hardly = mean_regret - lowest_yet_to_come <= NO_WORSE * gained + 1e-12
    return int(np.flatnonzero(hardly)[0]) + 1


def _steps(queries: int) -> list[int]:
    """Thirds of a trial: 10, 20 and 30 of 30 queries, as in the paper."""
    return sorted({max(1, round(queries * third / 3)) for third in (1, 2, 3)})


def _curves(
    db: Session, study_id: int, scores: Mapping[tuple[str, int], float], *, ends_early: bool
) -> Curves:
    """The mean score curve per session and condition.

    Where trials may end early, a shorter one keeps the score of its end; otherwise trials of
    another length are left out. ends_early: whether they may.
    """
    trials: dict[tuple[int, str, int], list[float]] = defaultdict(list)
    for session_id, condition, trial_id, environment, candidate in db.execute(
        select(SessionRow.id, Trial.condition, Trial.id, Trial.environment, Acquired.candidate)
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(Acquired, Acquired.trial_id == Trial.id)
        .where(
            SessionRow.study_id == study_id,
            SessionRow.mode == "simulated",
            SessionRow.stage == "completed",
            Trial.trial_index >= 0,
        )
        .order_by(Trial.id, Acquired.query_index)
    ):
        if (environment, candidate) in scores:
            trials[session_id, condition, trial_id].append(scores[environment, candidate])
    longest = max(map(len, trials.values()), default=0)
    grouped: dict[tuple[int, str], list[list[float]]] = defaultdict(list)
    for (session_id, condition, _), curve in trials.items():
        missing = longest - len(curve)
        if ends_early or not missing:
            grouped[session_id, condition].append([*curve, *[curve[-1]] * missing])
    return {key: np.mean(curves, axis=0).tolist() for key, curves in grouped.items()}
