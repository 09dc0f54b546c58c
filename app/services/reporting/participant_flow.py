"""The part of a report on the flow of participants, from arrival to analysis.

It follows the CONSORT flow diagram (https://www.consort-spirit.org) and includes everyone who came.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sqlalchemy import case, func, select
from sqlalchemy.orm import Session

from app.services.export.table import Request, of_trials, sessions_of
from app.services.monitoring.overview import median_minutes
from app.services.monitoring.session_list import SessionLine
from app.storage.models.studies import QueryRow, Response, SessionRow, Trial

from .document import Block, Heading, Paragraph, Table, many


@dataclass(frozen=True)
class Flow:
    """Numbers of sessions of the requested modes.

    arrived: agreed or declined; people who left the consent page without either are not recorded.
    deleted: at the participant's wish. under_way: not ended. left_out: excluded by the filter.
    unanswered: not excluded, but without an answer that counts. counted: the rest.
    """

    arrived: int
    deleted: int
    declined: int
    screened_out: int
    consented: int
    began: int
    withdrawn: int
    under_way: int
    completed: int
    left_out: int
    unanswered: int
    counted: int


@dataclass(frozen=True)
class Answers:
    """Numbers of people, answers and skips in the requested trials, and their sessions."""

    sessions: frozenset[str]
    people: int
    answers: int
    skips: int


def answers_of(db: Session, request: Request) -> Answers:
    """Count the answers in the sessions that the filter admits, without the practice."""
    statement = of_trials(
        select(
            SessionRow.public_id,
            SessionRow.participant_id,
            func.count(Response.id),
            func.sum(case((Response.response == "skip", 1), else_=0)),
        )
        .join(Trial, Trial.session_id == SessionRow.id)
        .join(QueryRow, QueryRow.trial_id == Trial.id)
        .join(Response, Response.query_id == QueryRow.id)
        .where(Trial.trial_index >= 0)
        .group_by(SessionRow.public_id, SessionRow.participant_id),
        request,
    )
    rows = db.execute(statement).all()
    return Answers(
        frozenset(public_id for public_id, *_ in rows),
        len({person for _, person, *_ in rows}),
        sum(int(answers) for *_, answers, _ in rows),
        sum(int(skips) for *_, skips in rows),
    )


def count(
    lines: Sequence[SessionLine], deleted: int, declined: int, let_through: int, answered: int
) -> Flow:
    """Compute the numbers of the flow.

    lines: all sessions of the modes. deleted, declined: people without a session. let_through:
    sessions that the filter admits. answered: those of them with an answer that counts.
    """
    stages = [line.stage for line in lines]
    ended = {name: stages.count(name) for name in ("declined", "screened_out", "withdrawn")}
    completed = stages.count("completed")
    under_way = len(lines) - completed - sum(ended.values())
    ended["declined"] += declined
    return Flow(
        arrived=len(lines) + deleted + declined,
        deleted=deleted,
        consented=sum(line.consented for line in lines),
        began=sum(line.began for line in lines),
        completed=completed,
        under_way=under_way,
        left_out=len(lines) - let_through,
        unanswered=let_through - answered,
        counted=answered,
        **ended,
    )


def let_through(db: Session, request: Request) -> int:
    """Number of sessions that the filter admits."""
    number = select(func.count(SessionRow.id)).where(*sessions_of(request))
    return db.scalar(number) or 0


def flow(
    found: Flow, rests_on: Answers, lines: Sequence[SessionLine], request: Request
) -> Iterator[Block]:
    """The blocks of this part. lines: the counted sessions."""
    yield Heading("Flow of participants")
    yield Table(
        "Sessions, from arriving to being counted",
        ("Step", "Sessions"),
        [
            ("Arrived", str(found.arrived)),
            ("Deleted at their person's wish", str(found.deleted)),
            ("Declined to consent", str(found.declined)),
            ("Screened out", str(found.screened_out)),
            ("Consented", str(found.consented)),
            ("Began the queries", str(found.began)),
            ("Withdrew", str(found.withdrawn)),
            ("Not finished", str(found.under_way)),
            ("Completed", str(found.completed)),
            ("Left out by the filter", str(found.left_out)),
            ("Without an answer that counts", str(found.unanswered)),
            ("Counted in this report", str(found.counted)),
        ],
    )
    yield Paragraph(
        "Arrived are those who agreed or declined: visitors who left the consent page without a"
        " word are not counted. Who declines there leaves nothing but a number, which counts"
        " presses of the button."
    )
    said = (
        f"What follows rests on {many(found.counted, 'session')} of"
        f" {many(rests_on.people, 'participant')} with {many(rests_on.answers, 'answer')}, of which"
        f" {many(rests_on.skips, 'is a skip', 'are skips')}."
    )
    if request.conditions:
        said += f" Only trials under {', '.join(request.conditions)} are counted."
    minutes = median_minutes(lines)
    if minutes is not None:
        said += (
            f" The median completed session took {minutes:.1f} minutes, breaks"
            f"{' and other conditions' if request.conditions else ''} included."
        )
    yield Paragraph(said)
