"""Questionnaires of a session: taking their answers, all together or not at all."""

from __future__ import annotations

from collections.abc import Mapping

from app.storage.tables import QuestionnaireAnswer
from app.study import protocol
from app.study.protocol import AFTER_TRIAL, Stage
from app.study.questionnaire import read_answers

from . import sessions, studies, trials
from . import state as session_state
from .errors import AnswersRefusedError
from .state import State
from .studio import Studio

#: The trial index of what is asked at the end.
AT_THE_END_INDEX = -1


def answer(studio: Studio, token: str, answers: Mapping[str, object]) -> State:
    """Store the answers to the open questionnaire, and move on.

    Raises AnswersRefusedError with every fault, and then stores none.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        plan = studies.stored_plan(row.plan)
        now = studio.now()
        page, finished = row.query_index, row.trial_index
        if row.stage == Stage.QUESTIONNAIRE:
            values, faults = read_answers(plan.items(page), answers)
            if faults:
                raise AnswersRefusedError(tuple(faults), row.stage)
        else:
            values = {}
        sessions.advance(studio, row, protocol.Answered(at=now))
        session.add_all(
            QuestionnaireAnswer(
                session_id=row.id,
                trial_index=finished - 1 if page == AFTER_TRIAL else AT_THE_END_INDEX,
                item=item,
                value=value,
                answered_at=now,
            )
            for item, value in values.items()
        )
        trials.arrive(studio, session, row)
        return session_state.describe(studio, session, row)
