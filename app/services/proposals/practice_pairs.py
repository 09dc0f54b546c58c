"""Practice queries before the first trial: random pairs, stored apart and never learnt from."""

from __future__ import annotations

import numpy as np

from app.pbbo import ENGINE_VERSION
from app.study.stage_settings import PRACTICE

from .proposer import CandidateSet, ProposedQuery

#: Separates the random stream of practice pairs from the other uses of a trial's seed.
_DRAW = 105


def pair(candidate_set: CandidateSet, seed: int, query_index: int) -> ProposedQuery:
    """Draw the practice query with this index: two candidates, and a recording of each. Pure."""
    rng = np.random.default_rng([seed, _DRAW, query_index])
    left, right = (
        int(index) for index in rng.choice(len(candidate_set.recordings), 2, replace=False)
    )
    shown = [candidate_set.recordings[index] for index in (left, right)]
    return ProposedQuery(
        query_index=query_index,
        trial_type=PRACTICE,
        left_candidate=left,
        right_candidate=right,
        left=shown[0][int(rng.integers(len(shown[0])))],
        right=shown[1][int(rng.integers(len(shown[1])))],
        acquisition="random",
        seed=seed,
        engine_version=ENGINE_VERSION,
        likelier="left",
    )
