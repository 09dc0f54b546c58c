"""The part of a report that counts who came, how far they came, and who is counted.

After the flow diagram of CONSORT (https://www.consort-spirit.org): everybody who came is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.export.columns import Request, sessions_of
from app.services.results import SessionLine
from app.services.watching.overview import median_minutes
from app.storage.tables import SessionRow

from .blocks import Block, Heading, Paragraph, Table


@dataclass(frozen=True)
class Flow:
    """How many sessions of the modes that are asked for; a session is one passage of a person.

    deleted: at their person's wish; nothing else is known of them, and they are in no other number
    but `arrived`. under_way: neither ended nor left. left_out: by the filter. counted: the rest.
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
    counted: int


def count(lines: Sequence[SessionLine], deleted: int, counted: int) -> Flow:
    """lines: all sessions of the modes. counted: how many of them the filter lets through."""
    stages = [line.stage for line in lines]
    ended = {name: stages.count(name) for name in ("declined", "screened_out", "withdrawn")}
    completed = stages.count("completed")
    return Flow(
        arrived=len(lines) + deleted,
        deleted=deleted,
        consented=sum(line.consented for line in lines),
        began=sum(line.began for line in lines),
        completed=completed,
        under_way=len(lines) - completed - sum(ended.values()),
        left_out=len(lines) - counted,
        counted=counted,
        **ended,
    )


def counted_sessions(session: Session, request: Request) -> frozenset[str]:
    """The pseudonyms of the sessions that the filter lets through."""
    return frozenset(session.scalars(select(SessionRow.public_id).where(*sessions_of(request))))


def flow(found: Flow, lines: Sequence[SessionLine]) -> Iterator[Block]:
    """lines: those that are counted."""
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
            ("Counted in this report", str(found.counted)),
        ],
    )
    people = len({line.participant_id for line in lines})
    answered, skips = sum(line.answered for line in lines), sum(line.skips for line in lines)
    said = (
        f"What follows rests on {found.counted} sessions of {people} participants with {answered}"
        f" answers, of which {skips} are skips."
    )
    minutes = median_minutes(lines)
    if minutes is not None:
        said += f" The median completed session took {minutes:.1f} minutes, breaks included."
    yield Paragraph(said)
