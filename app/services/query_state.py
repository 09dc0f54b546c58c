"""What the page of a query may know of it: two videos, and how they may be answered."""

from __future__ import annotations

from typing import Any

from sqlalchemy.orm import Session

from app.storage.tables import SessionRow
from app.study.checks import Kind
from app.study.plan import Condition, Plan
from app.study.protocol import Stage
from app.study.stages import PRACTICE_INDEX

from . import practice, queries, undo_offer
from .course import check_at, kind_at, learned, teaches
from .proposals import Clip, NextQuery, TrialInHand
from .queries import Standing
from .recordings import video_url
from .studies import stored_plan
from .studio import Studio
from .video_addresses import Place


def describe(
    studio: Studio, session: Session, row: SessionRow, known: Standing | None = None
) -> dict[str, Any]:
    """The open query of STATE. What a study does not ask for is not in it.

    known: where the trial stands, if whoever asks has just brought it there.
    """
    plan = stored_plan(row.plan)
    practising = row.stage == Stage.PRACTICE
    trial_index = PRACTICE_INDEX if practising else row.trial_index
    trial = known or queries.standing(session, row, trial_index)
    query = trial.asked
    space = studio.proposer.space(row.study_id, trial.environment)
    condition = plan.conditions[row.trial_conditions[row.trial_index]]
    place = (trial_index, query.query_index)
    coming, then = _coming(studio, row, trial), _place_after(row, trial)
    clips = [clip for following in coming for clip in (following.left, following.right)]
    state: dict[str, Any] = {
        "id": trial.public_id,
        "left": video(studio, row, space.clip(query.left, query.left_recording), place),
        "right": video(studio, row, space.clip(query.right, query.right_recording), place),
        "skip": skip_of(plan, condition, row.language),
        "prefetch": list(dict.fromkeys(_address(studio, row, clip, then) for clip in clips)),
    }
    if practising:
        state["practice"] = True
    if undo := _undo(studio, session, row, trial):
        state["undo"] = undo
    if plan.query.watch_once:
        state["watch_once"] = True
    return state


def _undo(
    studio: Studio, session: Session, row: SessionRow, trial: Standing
) -> dict[str, str | float] | None:
    """What the page of the open query says of undoing the response before it, while it may."""
    offer = undo_offer.find(session, row, trial, studio.now())
    seconds_left = round(offer.seconds_left, 1) if offer is not None else 0.0
    if offer is None or seconds_left <= 0:
        return None
    return {"query_id": offer.query.public_id, "seconds_left": seconds_left}


def video(studio: Studio, row: SessionRow, clip: Clip, place: Place) -> dict[str, Any]:
    """A recording as the session's browser knows it, at one place."""
    return {"url": _address(studio, row, clip, place), "duration_s": clip.duration_s}


def _address(studio: Studio, row: SessionRow, clip: Clip, place: Place) -> str:
    return video_url(studio.addresses.of(row, clip.id, place))


def skip_of(plan: Plan, condition: Condition, language: str) -> dict[str, Any] | None:
    """The skip button of a condition; None if it has none."""
    skip = condition.skip
    if skip is None:
        return None
    state: dict[str, Any] = {"label": plan.text(skip.label, language)}
    if skip.reasons:
        state["reasons"] = [
            {"name": name, "label": plan.text(label, language)}
            for name, label in skip.reasons.items()
        ]
    return state


def _coming(studio: Studio, row: SessionRow, trial: Standing) -> list[NextQuery]:
    """What may come next, the likeliest first, as far as it is worked out."""
    in_hand = queries.trial_in_hand(row, trial.trial_index, trial.seed, trial.asked.engine_version)
    if trial.trial_index == PRACTICE_INDEX:
        return [_after_practice(studio, row, in_hand)]
    record, query = trial.record, trial.asked
    kind = kind_at(in_hand, query.query_index + 1)
    history = learned(in_hand, record)
    pair = (query.left, query.right)
    coming = []
    if teaches(in_hand, query.trial_type):
        coming = studio.proposer.possible_queries(in_hand, history, pair)
        studio.proposer.precompute(in_hand, history, pair)
    elif (known := studio.proposer.cached_step(in_hand, history)) and known.next:
        coming = [known.next]
    # After the last query none follows, and yet what its response will have taught is asked for.
    if kind in (None, Kind.MODEL):
        return coming
    space = studio.proposer.space(in_hand.study_id, in_hand.environment)
    check = check_at(space, in_hand, record, query.query_index + 1)
    studio.proposer.render([check.left, check.right])
    return [check]


def _place_after(row: SessionRow, trial: Standing) -> Place:
    """Where what follows the open query will be shown."""
    is_last = row.query_index + 1 >= stored_plan(row.plan).practice.queries
    if trial.trial_index == PRACTICE_INDEX and is_last:
        return (0, 0)
    return (trial.trial_index, trial.asked.query_index + 1)


def _after_practice(studio: Studio, row: SessionRow, in_hand: TrialInHand) -> NextQuery:
    """What follows the open practice query: it does not depend on the response."""
    if row.query_index + 1 < stored_plan(row.plan).practice.queries:
        space = studio.proposer.space(in_hand.study_id, in_hand.environment)
        return practice.pair(space, in_hand.seed, row.query_index + 1)
    first = studio.proposer.step(queries.trial_in_hand(row, 0, queries.trial_seed(row, 0)), ()).next
    assert first is not None
    return first
