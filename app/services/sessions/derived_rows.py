"""What responses have taught the model, as it is stored: preferences, and w_acq after each.

Derived from the responses: it is kept to be exported, and could be worked out again (`replay`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sqlalchemy.orm import Session

from app.services.proposals.proposer import NextStep
from app.services.proposals.trial_schedule import AnsweredQueries
from app.storage.bulk_insert import insert_rows
from app.storage.models.studies import Acquired, PreferenceRow, QueryRow


def store(db: Session, query: QueryRow, step: NextStep, taught: AnsweredQueries) -> None:
    """Store what the response to this query taught. step: what follows `taught`, which ends there.

    Of preferences that is what its response says, and what skips before it had waited for.
    """
    new = [
        {"trial_id": query.trial_id, **row}
        for row in preferences(step, taught)
        if query.query_index in (row["query_index"], row["drawn_from_query_index"])
    ]
    insert_rows(db, PreferenceRow, new)
    if step.acquired is not None:
        acquired = {
            "trial_id": query.trial_id,
            "query_index": query.query_index,
            "candidate": step.acquired.candidate,
            "posterior_mean": step.acquired.mean,
            "posterior_std": step.acquired.std,
        }
        insert_rows(db, Acquired, [acquired])


def preferences(step: NextStep, taught: AnsweredQueries) -> Iterator[dict[str, Any]]:
    """All preferences of a step, in order, by the columns that the table has for them.

    The optimiser numbers the queries that it learnt from, `taught`; the trial numbers its places.
    """
    for index, preference in enumerate(step.preferences):
        drawn = preference.drawn_from_query_index
        yield {
            "preference_index": index,
            "winner": preference.winner,
            "loser": preference.loser,
            "origin": preference.origin,
            "query_index": taught[preference.query_index].query_index,
            "drawn_from_query_index": None if drawn is None else taught[drawn].query_index,
        }
