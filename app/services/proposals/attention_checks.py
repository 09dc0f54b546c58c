"""Attention checks: pairs of a recording known to be good and one known to be bad.

The plan names the good and bad candidates; without them, the recordings' scores decide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from app.study.attention_checks import CandidatePoint, Kind

from .proposer import CandidateSet, ProposedQuery, RecordingRef, TrialSpec

#: Share of the scored recordings at each end that counts as known, if the plan names no candidates.
KNOWN_BY_SCORE = 0.1

#: Value of a check's `acquisition` column, by the side of the good recording.
GOOD_SIDE = {"left": "good-left", "right": "good-right"}

_Known = Sequence[tuple[int, RecordingRef]]


def attention(
    candidate_set: CandidateSet,
    trial: TrialSpec,
    place: int,
    rng: np.random.Generator,
    usable: Callable[[RecordingRef], bool] = lambda _: True,
) -> ProposedQuery | None:
    """Draw an attention check from the known recordings.

    place: index of the query within the trial. usable: whether a recording can be shown. Returns
    None if no pair of a good and a bad recording of different candidates is left.
    """
    good, bad = (
        [(candidate, recording) for candidate, recording in known if usable(recording)]
        for known in known_ends(candidate_set, trial)
    )
    pairs = [(best, worst) for best in good for worst in bad if best[0] != worst[0]]
    if not pairs:
        return None
    best, worst = pairs[int(rng.integers(len(pairs)))]
    side = ("left", "right")[int(rng.integers(2))]
    left, right = (best, worst) if side == "left" else (worst, best)
    return ProposedQuery(
        query_index=place,
        trial_type=Kind.ATTENTION.value,
        left_candidate=left[0],
        right_candidate=right[0],
        left=left[1],
        right=right[1],
        acquisition=GOOD_SIDE[side],
        seed=trial.seed,
        engine_version=trial.engine_version,
        likelier=side,
    )


def known_ends(candidate_set: CandidateSet, trial: TrialSpec) -> tuple[_Known, _Known]:
    """The known good recordings and the known bad ones, each with its candidate's index."""
    if trial.checks.good:
        good, bad = trial.checks.good, trial.checks.bad
        return list(_of(candidate_set, trial, good)), list(_of(candidate_set, trial, bad))
    scored = sorted(
        (recording.score, candidate, place)
        for candidate, recordings in enumerate(candidate_set.recordings)
        for place, recording in enumerate(recordings)
        if recording.score is not None
    )
    some = max(1, round(len(scored) * KNOWN_BY_SCORE))
    ends = (scored[-some:], scored[:some])
    known = [
        [(candidate, candidate_set.recordings[candidate][at]) for _, candidate, at in end]
        for end in ends
    ]
    return known[0], known[1]


def _of(
    candidate_set: CandidateSet, trial: TrialSpec, points: Sequence[CandidatePoint]
) -> Iterator[tuple[int, RecordingRef]]:
    for point in points:
        wanted = [point[name] for name in candidate_set.parameters]
        for candidate in np.flatnonzero(np.isclose(candidate_set.candidates, wanted).all(axis=1)):
            for recording in candidate_set.recordings[int(candidate)]:
                yield int(candidate), recording
