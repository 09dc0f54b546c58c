"""Stores what follows from responses: preferences, and the acquired candidate after each.

These rows are derived and stored for export; `replay` computes them again from the responses.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sqlalchemy import delete
from sqlalchemy.orm import Session

from app.services.proposals.proposer import NextStep
from app.services.proposals.trial_schedule import AnsweredQueries
from app.storage.bulk_insert import insert_rows
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow


def store(db: Session, query: QueryRow, step: NextStep, training: AnsweredQueries) -> None:
    """Store the rows that follow from the response to this query.

    step: the step after `taught`, the training records up to and including this query. New
    preferences are those of this response, and those of earlier skips that were waiting for it.
    """
    store_new_preferences(db, query, step, training)
    store_acquired(db, query, step)


def store_new_preferences(
    db: Session, query: QueryRow, step: NextStep, training: AnsweredQueries
) -> None:
    """Store the preferences that the response to this query has added."""
    new = [
        {"trial_id": query.trial_id, **row}
        for row in preferences(step, training)
        if query.query_index in (row["query_index"], row["drawn_from_query_index"])
    ]
    insert_rows(db, PreferenceRow, new)


def store_acquired(
    db: Session, query: QueryRow, step: NextStep, computed_from: dict[str, Any] | None = None
) -> None:
    """Store the candidate acquired after the response to this query.

    computed_from: in a search space given by ranges, what it was computed from.
    """
    if step.acquired is not None:
        acquired: dict[str, Any] = {
            "trial_id": query.trial_id,
            "query_index": query.query_index,
            "candidate": step.acquired.candidate,
            "posterior_mean": step.acquired.mean,
            "posterior_std": step.acquired.std,
            "sureness": step.acquired.sureness,
        }
        if computed_from is not None:
            acquired["computed_from"] = computed_from
        insert_rows(db, Acquired, [acquired])


def replace_preferences(
    db: Session, trial_id: int, step: NextStep, training: AnsweredQueries
) -> None:
    """Store all preferences of the trial in place of those it has, which may be numbered anew."""
    db.execute(delete(PreferenceRow).where(PreferenceRow.trial_id == trial_id))
    new = [{"trial_id": trial_id, **row} for row in preferences(step, training)]
    insert_rows(db, PreferenceRow, new)


def preferences(step: NextStep, training: AnsweredQueries) -> Iterator[dict[str, Any]]:
    """All preferences of a step in order, as columns of their table.

    The optimiser numbers the training queries `taught`; the rows have the trial's query indices.
    """
    for index, preference in enumerate(step.preferences):
        drawn = preference.drawn_from_query_index
        yield {
            "preference_index": index,
            "winner": preference.winner,
            "loser": preference.loser,
            "origin": preference.origin,
            "query_index": training[preference.query_index].query_index,
            "drawn_from_query_index": None if drawn is None else training[drawn].query_index,
        }
