"""The part of a report on the reliability of the answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.services.export.table import Request, trials_of
from app.services.monitoring.check_outcomes import check_outcomes
from app.services.monitoring.data_quality import LABELS, RULES
from app.services.monitoring.session_list import SessionLine
from app.storage.models.studies import QueryRow, SessionRow, Trial, UndoneResponse

from .document import Block, Heading, Paragraph, Table, many


def reliability(db: Session, request: Request, lines: Sequence[SessionLine]) -> Iterator[Block]:
    """The blocks of this part. lines: the counted sessions."""
    yield Heading("Quality of the data")
    flagged = Counter(flag for line in lines for flag in line.flags)
    yield Table(
        "What was noticed of sessions",
        ("Flag", "Sessions", "Raised when"),
        [(LABELS[flag], str(flagged[flag]), rule) for flag, rule in RULES.items()],
    )
    clean = sum(not line.flags for line in lines)
    checks = Counter(
        (outcome.kind, outcome.passed)
        for outcome in check_outcomes(db, *trials_of(request))
        if outcome.passed is not None and outcome.trial_index >= 0
    )
    said = [f"{clean} of {many(len(lines), 'session')} with answers have no flag."]
    if request.conditions:
        said.append("A flag is of a whole session, all its conditions included.")
    for kind, name in (("attention", "attention checks"), ("repeat", "repeats")):
        passed, failed = checks[kind, True], checks[kind, False]
        if passed + failed:
            said.append(f"Of {passed + failed} {name}, {passed} were passed.")
    said.append(
        f"{many(_set_aside(db, request), 'pair was', 'pairs were')} set aside because a video"
        f" did not play, and {many(_undone(db, request), 'answer was', 'answers were')} taken"
        " back at once."
    )
    yield Paragraph(" ".join(said))


def _set_aside(db: Session, request: Request) -> int:
    statement = (
        select(func.count(QueryRow.id))
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(QueryRow.set_aside_at.is_not(None), Trial.trial_index >= 0, *trials_of(request))
    )
    return db.scalar(statement) or 0


def _undone(db: Session, request: Request) -> int:
    statement = (
        select(func.count(UndoneResponse.id))
        .join(QueryRow, UndoneResponse.query_id == QueryRow.id)
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .where(Trial.trial_index >= 0, *trials_of(request))
    )
    return db.scalar(statement) or 0
