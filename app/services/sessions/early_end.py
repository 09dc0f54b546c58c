"""Whether a stored trial ended where its model was as sure as its plan wants."""

from __future__ import annotations

from collections.abc import Sequence

from app.services.proposals.proposer import TrialSpec
from app.storage.models.studies import Trial

WHAT = "trial ended early after query"


def difference(
    trial: Trial, spec: TrialSpec, answered: int, sure: Sequence[int]
) -> tuple[int | None, int | None] | None:
    """The last query of a trial that ended early, stored and computed; None if they agree.

    Of the two, None stands for a trial that did not end early. answered: number of its responses.
    sure: indices of the queries by whose responses the model was sure enough, in order.
    """
    most = spec.queries + spec.repeats + spec.attention
    has_ended = trial.ended_at is not None and answered < most
    stored = answered - 1 if has_ended else None
    computed = sure[0] if sure and sure[0] < most - 1 else None
    return None if stored == computed else (stored, computed)
