"""The posterior of one trial: over its list of candidates, or over its search space."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals.posterior_cache import PROBABILITY
from app.services.proposals.proposer import TrialSpec
from app.services.proposals.trial_schedule import AnsweredQueries, training_history
from app.services.sessions import box_trials, queries
from app.services.sessions.box_trials import BoxTrial, Sources
from app.services.studies.repository import stored_plan
from app.storage.models.studies import Acquired, Trial

from .box_points import points_to_draw
from .result import Result, Row


def posterior(app: AppContext, db: Session, trial: Trial) -> Result:
    """Posterior mean and standard deviation after all answers so far, and what may be best."""
    spec = queries.trial_spec(
        trial.session, trial.trial_index, trial.seed, trial.queries[0].engine_version
    )
    record = queries.read_record(db, trial.id)
    over = box_trials.trial_of(trial.session, spec)
    last = db.scalars(
        select(Acquired)
        .where(Acquired.trial_id == trial.id)
        .order_by(Acquired.query_index.desc())
        .limit(1)
    ).first()
    if over is not None:
        return _over_space(app, db, trial, over, record, last)
    return _over_list(app, trial, spec, record, last)


def is_sure(sureness: float | None, within: float, shared: int | None = None) -> str:
    """How sure a trial is, as a sentence; empty if it was not computed.

    shared: the candidate acquired by a model that people share.
    """
    if sureness is None:
        return ""
    model = "The model" if shared is None else "The model that people share"
    than = "" if shared is None else f" than candidate {shared}"
    return (
        f" {model} is {percent(sureness)} sure that no candidate is better{than} by more than"
        f" {percent(within)} of the range."
    )


def percent(share: float) -> str:
    """A share in percent; one that is not whole is never called 0 % or 100 %."""
    if 0 < share < 0.005:
        return "below 1 %"
    if 0.995 <= share < 1:
        return "over 99 %"
    return f"{share:.0%}".replace("%", " %")


def _over_list(
    app: AppContext, trial: Trial, spec: TrialSpec, record: AnsweredQueries, last: Acquired | None
) -> Result:
    space = app.proposer.candidate_set(spec.study_id, spec.environment)
    history = training_history(spec, record)
    asked = (space.candidates, spec.method, spec.settings, spec.seed, history)
    belief = app.proposer.posteriors.posterior(*asked)
    likely = app.proposer.posteriors.may_be_best(*asked)
    if belief is None or likely is None:
        return _no_model(trial, len(history))
    mean, std = belief
    shown = _times_shown(record)
    parameters = [
        dict(zip(space.parameters, map(float, point), strict=True)) for point in space.candidates
    ]
    rows: list[Row] = [
        {
            "candidate": candidate,
            **parameters[candidate],
            "posterior_mean": float(mean[candidate]),
            "posterior_std": float(std[candidate]),
            "times_shown": shown[candidate],
            "may_be_best": candidate in likely,
        }
        for candidate in range(len(mean))
    ]
    best = int(np.argmax(mean))
    says = (
        f"After {len(history)} answers the mean is highest at candidate {best}"
        f" ({_where(parameters[best])}); {len(shown)} of {len(mean)} candidates were shown."
        f"{_sure_of_list(trial, spec, last)}"
        f" With {percent(PROBABILITY)} the best one is among {len(likely)} of {len(mean)}"
        f" candidates: {_spans([parameters[candidate] for candidate in likely])}."
    )
    return Result(rows, says, extra={"best": rows[best], "ground": rows})


def _sure_of_list(trial: Trial, spec: TrialSpec, last: Acquired | None) -> str:
    if last is None:
        return ""
    condition = stored_plan(trial.session.plan).conditions[
        trial.session.trial_conditions[trial.trial_index]
    ]
    shared = last.candidate if condition.is_shared else None
    return is_sure(last.sureness, spec.within or 0.0, shared)


def _over_space(
    app: AppContext,
    db: Session,
    trial: Trial,
    over: BoxTrial,
    record: AnsweredQueries,
    last: Acquired | None,
) -> Result:
    """The belief after the last response that was learnt from, as its row says."""
    if last is None:
        return _no_model(trial, 0)
    sources = Sources.from_json(last.computed_from or {})
    needed = box_trials.candidates_of(record, box_trials.Barred(), sources) | {last.candidate}
    points = box_trials.read_points(db, over, needed)
    request = box_trials.request(over, record, sources, points, proposes=False, acquires=False)
    names = over.space.names
    drawn = points_to_draw(over.space, points[last.candidate])
    shown = _times_shown(record)
    seen = sorted({*shown, last.candidate})
    asked = [*(point for _, point in drawn), *(points[candidate] for candidate in seen)]
    belief = app.proposer.posteriors.over_space(request, asked)
    if belief is None:
        return _no_model(trial, len(sources.answered))
    labels = stored_plan(trial.session.plan).parameters
    assert tuple(one.name for one in labels) == names

    def row(number: int, candidate: int | None, varies: str | None) -> Row:
        return {
            "candidate": candidate,
            "varies": varies,
            **dict(zip(names, asked[number], strict=True)),
            "posterior_mean": float(belief.mean[number]),
            "posterior_std": float(belief.std[number]),
            "times_shown": 0 if candidate is None else shown[candidate],
        }

    ground = [row(number, None, varies) for number, (varies, _) in enumerate(drawn)]
    known = [row(len(drawn) + place, candidate, None) for place, candidate in enumerate(seen)]
    best = known[seen.index(last.candidate)]
    likely = [dict(zip(names, point, strict=True)) for point in belief.may_be_best.tolist()]
    says = (
        f"After {len(sources.answered)} answers the mean is highest at candidate {last.candidate}"
        f" ({_where({name: best[name] for name in names})}); {len(shown)} points were shown."
        f"{is_sure(last.sureness, over.spec.within or 0.0)}"
        f" With {percent(PROBABILITY)} the best one is among {len(likely)} points that were looked"
        f" at: {_spans(likely)}."
    )
    return Result([*ground, *known], says, extra={"best": best, "ground": ground})


def _no_model(trial: Trial, answers: int) -> Result:
    return Result((), f"There is no model to show: {trial.method}, {answers} answers.")


def _times_shown(record: AnsweredQueries) -> Counter[int]:
    return Counter(candidate for one in record for candidate in (one.left, one.right))


def _where(parameters: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in parameters.items())


def _spans(points: Sequence[Mapping[str, Any]]) -> str:
    """From where to where each parameter goes in these points."""
    found = []
    for name in points[0]:
        low, high = min(at[name] for at in points), max(at[name] for at in points)
        found.append(f"{name} {low:.3g}" if low == high else f"{name} {low:.3g} to {high:.3g}")
    return ", ".join(found)
