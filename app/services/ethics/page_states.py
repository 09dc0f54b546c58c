"""The states of all evaluator pages, generated from a fictitious session.

The session exists in memory only. Each of its stages is rendered as for a real participant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.proposals.proposer import RecordingRef
from app.services.sessions import query_view
from app.services.sessions import state_view as session_state
from app.services.sessions.state_view import State
from app.services.studies.repository import StudyInfo
from app.services.studies.session_modes import LIVE
from app.storage.models.studies import PlanVersion, SessionRow, Study
from app.study.plan import Plan
from app.study.stages import AFTER_TRIAL, AT_THE_END, Stage, position

#: Seed of the fictitious session, so that it is always the same.
_SEED = 0
_NOBODY = -1


@dataclass(frozen=True)
class Screen:
    """One evaluator page: its name, and the session state that it shows."""

    name: str
    state: State


def screens(app: AppContext, study: StudyInfo, language: str) -> list[Screen]:
    """All pages of a session in one language, in the order in which participants see them."""
    plan = study.plan
    with app.database.read() as db:
        row = _made_up(db, study, language)
        return [Screen(name, _described(app, db, row, plan)) for name in _walk(app, row, plan)]


def still_clips(app: AppContext, study: StudyInfo) -> list[RecordingRef]:
    """Two recordings whose videos exist already, for screenshots of the pages."""
    clips = [
        clip
        for environment in study.plan.used_environments
        for clip in app.proposer.candidate_set(study.id, environment).all_recordings
    ]
    there = app.recordings.sizes(clips)
    ready = [clip for clip in clips if clip.locator in there]
    # The first and the last, because neighbours are runs of the same candidate.
    return [ready[0], ready[-1]] if ready else []


def _made_up(db: Session, study: StudyInfo, language: str) -> SessionRow:
    version = db.get_one(PlanVersion, study.plan_id)
    return SessionRow(
        study=db.get_one(Study, study.id),
        study_id=study.id,
        plan=version,
        plan_id=version.id,
        participant_id=_NOBODY,
        mode=LIVE,
        language=language,
        seed=_SEED,
        trial_conditions=[
            index
            for index in range(len(study.plan.conditions))
            for _ in range(study.plan.trials_per_condition)
        ],
        stage=Stage.CONSENT.value,
        trial_index=0,
        query_index=0,
        watched=[],
        trials=[],
    )


def _walk(app: AppContext, session: SessionRow, plan: Plan) -> Iterator[str]:
    """Move the session from stage to stage, and yield the name of each page."""

    def at(stage: Stage, trial_index: int = 0, query_index: int = 0) -> None:
        session.stage = stage.value
        session.trial_index, session.query_index = trial_index, query_index
        session.break_ends_at = None

    at(Stage.CONSENT)
    yield "consent"
    if plan.device_check is not None:
        at(Stage.DEVICE_CHECK)
        yield "device-check"
    at(Stage.INSTRUCTIONS)
    yield "instructions"
    if plan.familiarisation.videos:
        at(Stage.FAMILIARISATION)
        yield "familiarisation"
    if plan.practice.queries:
        at(Stage.PRACTICE)
        yield "practice"
    # On the page, conditions differ only in their skip button.
    shown: list[Any] = []
    for trial_index, condition in enumerate(session.trial_conditions):
        skip = plan.conditions[condition].skip
        if skip not in shown:
            shown.append(skip)
            at(Stage.QUERY, trial_index)
            yield f"comparison-{len(shown)}"
    if plan.items(AFTER_TRIAL):
        at(Stage.QUESTIONNAIRE, 1, AFTER_TRIAL)
        yield "questions-after-a-part"
    if plan.break_s and plan.trials > 1:
        at(Stage.BREAK, 1)
        session.break_ends_at = app.now() + timedelta(seconds=plan.break_s)
        yield "break"
    if plan.items(AT_THE_END):
        at(Stage.QUESTIONNAIRE, plan.trials, AT_THE_END)
        yield "questions-at-the-end"
    at(Stage.DEBRIEF, plan.trials)
    yield "debrief"
    at(Stage.COMPLETED, plan.trials)
    yield "completed"
    if plan.device_check is not None:
        at(Stage.SCREENED_OUT)
        yield "screened-out"
    at(Stage.WITHDRAWN)
    yield "stopped"
    at(Stage.DECLINED)
    yield "declined"


def _described(app: AppContext, db: Session, session: SessionRow, plan: Plan) -> State:
    if session.stage not in (Stage.QUERY, Stage.PRACTICE):
        return session_state.describe(app, db, session)
    condition = plan.conditions[session.trial_conditions[session.trial_index]]
    clips = app.proposer.candidate_set(session.study_id, condition.environment).all_recordings
    return {
        "stage": session.stage,
        "progress": position(plan, session_state.read_progress(session)),
        "study": session_state.study_of(plan, session.study.slug, session.language),
        "language": session.language,
        "query": {
            "id": "",
            "left": query_view.video(app, session, clips[0], (0, 0)),
            "right": query_view.video(app, session, clips[-1], (0, 0)),
            "skip": query_view.skip_of(plan, condition, session.language),
            "prefetch": [],
        },
    }
