"""An answer as it was sent, and whether its query takes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.services.proposals.trial_schedule import AskedQuery
from app.services.runtime.errors import (
    AlreadyAnsweredError,
    NotRecordedYetError,
    SetAsideError,
    SkipReasonError,
)
from app.services.studies.repository import stored_plan
from app.storage.models.studies import QueryRow, SessionRow

from .queries import ClientEvent


@dataclass(frozen=True)
class Answer:
    """A response, with the client events up to it."""

    query_id: str
    response: str
    rt_ms: float | None = None
    skip_reason: str | None = None
    client_events: Sequence[ClientEvent] = ()
    #: How many events the client dropped.
    left_out: int = 0


def is_new(session: SessionRow, query: QueryRow, answer: Answer) -> bool:
    """Whether the query has no response yet.

    Raises AlreadyAnsweredError if it has another response, SetAsideError if the query was replaced,
    and NotRecordedYetError if its videos do not exist yet.
    """
    if query.set_aside_at is not None:
        raise SetAsideError(
            "expected a response to the query that took this one's place: this one did not play",
            session.stage,
        )
    if query.response is None:
        if query.left_recording_id is None or query.right_recording_id is None:
            raise NotRecordedYetError(
                "expected a response to a pair that is shown: its videos are not recorded yet",
                session.stage,
            )
        return True
    if query.response.response != answer.response:
        raise AlreadyAnsweredError(
            f"expected {query.response.response!r} again, the response this query has, "
            f"got {answer.response!r}",
            session.stage,
        )
    return False


def check_reason(session: SessionRow, query: QueryRow, answer: Answer) -> None:
    """Raise SkipReasonError if a reason comes without a skip, or is not one that the study offers.

    A skip without a reason is accepted, for pages that were opened before reasons were offered. A
    study that offers none accepts any.
    """
    if answer.skip_reason is None:
        return
    if answer.response != "skip":
        raise SkipReasonError(
            f"expected a reason with a skip only, got one with {answer.response!r}", session.stage
        )
    plan = stored_plan(session.plan)
    # The practice uses the skip button of the first trial.
    skip = plan.conditions[session.trial_conditions[max(query.trial.trial_index, 0)]].skip
    offered = list(skip.reasons or ()) if skip else []
    if offered and answer.skip_reason not in offered:
        raise SkipReasonError(
            f"expected one of {', '.join(offered)}, got {answer.skip_reason!r}", session.stage
        )


def answered(query: QueryRow, answer: Answer) -> AskedQuery:
    """The query with this answer, as a row of the trial's history."""
    return AskedQuery(
        query_index=query.query_index,
        trial_type=query.trial_type,
        left=query.left_candidate,
        right=query.right_candidate,
        left_recording=query.left_recording_id,
        right_recording=query.right_recording_id,
        acquisition=query.acquisition,
        engine_version=query.engine_version,
        repeats=query.repeats_query_index,
        response=answer.response,
        skip_reason=answer.skip_reason,
    )
