"""The practice before the first trial: pairs at random, kept apart and never learnt from."""

from __future__ import annotations

import numpy as np

from app.pbbo import ENGINE_VERSION
from app.study.stage_settings import PRACTICE

from .proposer import CandidateSet, ProposedQuery

#: Tells the draw of practice pairs apart from every other use of a trial's seed.
_DRAW = 105


def pair(candidate_set: CandidateSet, seed: int, query_index: int) -> ProposedQuery:
    """The practice's query at this place: a pure function of its arguments."""
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
