"""Stores a session's questionnaire answers, all of them or none."""

from __future__ import annotations

from collections.abc import Mapping

from app.services.context import AppContext
from app.services.runtime.errors import AnswersRefusedError
from app.services.studies import repository
from app.storage.models.studies import QuestionnaireAnswer
from app.study import stages
from app.study.questionnaire import read_answers
from app.study.stages import AFTER_TRIAL, Stage

from . import lookup, shared_next, trial_start
from . import state_view as session_state
from .state_view import State

#: The trial index of the questionnaire at the end.
AT_THE_END_INDEX = -1


def answer(app: AppContext, token: str, answers: Mapping[str, object]) -> State:
    """Store the answers to the open questionnaire, and advance the session.

    Raises AnswersRefusedError with all validation errors, in which case nothing is stored.
    """
    return shared_next.computing(app, lambda: _answer(app, token, answers))


def _answer(app: AppContext, token: str, answers: Mapping[str, object]) -> State:
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        plan = repository.stored_plan(session.plan)
        now = app.now()
        page, finished = session.query_index, session.trial_index
        if session.stage == Stage.QUESTIONNAIRE:
            values, faults = read_answers(plan.items(page), answers)
            if faults:
                raise AnswersRefusedError(tuple(faults), session.stage)
        else:
            values = {}
        lookup.advance(app, session, stages.Answered(at=now))
        db.add_all(
            QuestionnaireAnswer(
                session_id=session.id,
                trial_index=finished - 1 if page == AFTER_TRIAL else AT_THE_END_INDEX,
                item=item,
                value=value,
                answered_at=now,
            )
            for item, value in values.items()
        )
        trial_start.enter_stage(app, db, session)
        return session_state.describe(app, db, session)
