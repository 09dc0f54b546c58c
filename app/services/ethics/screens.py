"""The states of a session that evaluators see pages of, without anybody being there.

A session is made up in memory and never stored: each of its stages is described just as it would be
for a person.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy.orm import Session

from app.services import query_state
from app.services import state as session_state
from app.services.modes import LIVE
from app.services.proposals import Clip
from app.services.state import State
from app.services.studies import StudyInfo
from app.services.studio import Studio
from app.storage.tables import PlanVersion, SessionRow, Study
from app.study.plan import Plan
from app.study.protocol import AFTER_TRIAL, AT_THE_END, Stage, position

#: Makes up the same session each time.
_SEED = 0
_NOBODY = -1


@dataclass(frozen=True)
class Screen:
    """One page that evaluators see: its name, and the state that it shows."""

    name: str
    state: State


def screens(studio: Studio, study: StudyInfo, language: str) -> list[Screen]:
    """Every page of a session in the order in which people come to them, in one language."""
    plan = study.plan
    with studio.database.read() as session:
        row = _made_up(session, study, language)
        return [
            Screen(name, _described(studio, session, row, plan))
            for name in _walk(studio, row, plan)
        ]


def still_clips(studio: Studio, study: StudyInfo) -> list[Clip]:
    """Two videos of the study that are there already, to stand in pictures of its pages."""
    clips = [
        clip
        for environment in study.plan.used_environments
        for clip in studio.proposer.space(study.id, environment).all_clips
    ]
    there = studio.recordings.sizes(clips)
    ready = [clip for clip in clips if clip.locator in there]
    # Two that differ: neighbours are runs of one candidate.
    return [ready[0], ready[-1]] if ready else []


def _made_up(session: Session, study: StudyInfo, language: str) -> SessionRow:
    version = session.get_one(PlanVersion, study.plan_id)
    return SessionRow(
        study=session.get_one(Study, study.id),
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


def _walk(studio: Studio, row: SessionRow, plan: Plan) -> Iterator[str]:
    """Move the session from stage to stage; the name of each page."""

    def at(stage: Stage, trial_index: int = 0, query_index: int = 0) -> None:
        row.stage = stage.value
        row.trial_index, row.query_index = trial_index, query_index
        row.break_ends_at = None

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
    # Conditions differ on the page by their skip button alone.
    shown: list[Any] = []
    for trial_index, condition in enumerate(row.trial_conditions):
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
        row.break_ends_at = studio.now() + timedelta(seconds=plan.break_s)
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


def _described(studio: Studio, session: Session, row: SessionRow, plan: Plan) -> State:
    if row.stage not in (Stage.QUERY, Stage.PRACTICE):
        return session_state.describe(studio, session, row)
    condition = plan.conditions[row.trial_conditions[row.trial_index]]
    clips = studio.proposer.space(row.study_id, condition.environment).all_clips
    return {
        "stage": row.stage,
        "progress": position(plan, session_state.read_progress(row)),
        "study": session_state.study_of(plan, row.study.slug, row.language),
        "language": row.language,
        "query": {
            "id": "",
            "left": query_state.video(studio, row, clips[0], (0, 0)),
            "right": query_state.video(studio, row, clips[-1], (0, 0)),
            "skip": query_state.skip_of(plan, condition, row.language),
            "prefetch": [],
        },
    }
