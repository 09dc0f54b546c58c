"""Stores what follows from a response under a shared model, with what it was computed from."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.pbbo import Preference
from app.services.proposals.proposer import NextStep
from app.services.proposals.trial_schedule import AnsweredQueries, AskedQuery, training_records
from app.storage.models.studies import QueryRow, Response

from . import derived_rows, shared_trials
from .shared_next import Step
from .shared_trials import Moment, SharedAnswer, SharedTrial, Sources


def store_derived(
    db: Session,
    trial: SharedTrial,
    query: QueryRow,
    step: Step,
    moment: Moment,
    own: SharedAnswer | None,
    record: AnsweredQueries,
) -> Sources:
    """Store the rows derived from the response to this query, which is stored already.

    Returns what the next query is proposed from. own: the answer; None if it is not learnt from.
    """
    known = [*(answer.id for answer in moment.answers), *moment.gone]
    if own is None:
        return shared_trials.sources(trial, step.used, known, step.avoided)
    response_id = db.scalars(select(Response.id).where(Response.query_id == query.id)).one()
    used = (*step.used, own._replace(id=response_id))
    sources = shared_trials.sources(trial, used, known, step.avoided)
    training = training_records(trial.spec, record)
    derived = NextStep(None, preferences(training), step.acquired)
    derived_rows.store_new_preferences(db, query, derived, training)
    derived_rows.store_acquired(db, query, derived, computed_from=sources.as_json())
    return sources


def preferences(training: Sequence[AskedQuery]) -> tuple[Preference, ...]:
    """The choices among these queries, numbered by them: nothing is drawn for a skip."""
    return tuple(
        Preference(
            *((one.left, one.right) if one.response == "left" else (one.right, one.left)),
            "answer",
            number,
        )
        for number, one in enumerate(training)
        if one.response != "skip"
    )
