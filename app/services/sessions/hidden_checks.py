"""Keeps the list of videos to prefetch from telling checks apart from queries of the model.

The query before a check and the check itself lead to one next query whatever is answered, and
queries of the model to several, so the number of addresses would tell an evaluator which queries
are checks. In studies with checks, videos that the trial has already shown fill the list up to the
largest number that a query can have. They exist already, so none of them has to be rendered.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.pbbo import allows_skip
from app.services.proposals.proposer import CandidateSet, RecordingRef
from app.services.studies.repository import stored_plan
from app.storage.models.studies import SessionRow

from .queries import OpenQuery

#: Separates this random stream from the other uses of a trial's seed.
_PADDING_DRAW = 108


def padded(
    clips: Sequence[RecordingRef],
    session: SessionRow,
    trial: OpenQuery,
    candidate_set: CandidateSet,
) -> list[RecordingRef]:
    """The videos that may come next, followed by others of the trial if its study has checks."""
    plan = stored_plan(session.plan)
    distinct = list({clip.id: clip for clip in clips}.values())
    if not (plan.checks.repeats or plan.checks.attention):
        return distinct
    condition = plan.conditions[session.trial_conditions[session.trial_index]]
    responses = 3 if allows_skip(condition.method) else 2
    known = {clip.id for clip in distinct}
    others: dict[int, RecordingRef] = {}
    for query in (*trial.record, trial.asked):
        for candidate, recording in (
            (query.left, query.left_recording),
            (query.right, query.right_recording),
        ):
            if recording is not None and recording not in known:
                others[recording] = candidate_set.recording(candidate, recording)
    # The same list each time it is asked for, or a second look would tell which videos belong.
    generator = np.random.default_rng([trial.seed, _PADDING_DRAW, trial.asked.query_index])
    order = generator.permutation(sorted(others))[: max(0, 2 * responses - len(distinct))]
    return [*distinct, *(others[int(recording)] for recording in order)]
