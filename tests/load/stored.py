"""What a crowd was told, held against what the database has."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import func, select

from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.ids import secret_hash
from app.services.runtime.settings import Settings
from app.services.sessions import replay
from app.storage.models.studies import QueryRow, Response, SessionRow, Trial
from tests.conftest import Idle

from . import fleet
from .crowd import Log

#: A response on its way when its evaluator left may be there or not.
InHand = Collection[tuple[str, str, str]]


def faults(
    settings: Settings,
    slug: str,
    log: Log,
    in_hand: InHand,
    notes: Sequence[dict[str, Any]] = (),
) -> list[str]:
    """A sentence for each promise that was not kept; none, if all were.

    notes: what machines wrote down.
    """
    app = open_app(settings, background=Idle(1))
    try:
        return [
            *faults_in(app, slug, log, in_hand),
            *(fleet.faults_in(app, notes) if notes else ()),
        ]
    finally:
        app.close()


def faults_in(app: AppContext, slug: str, log: Log, in_hand: InHand) -> list[str]:
    """As `faults`, of a studio that is open."""
    return [*_responses(app, log, in_hand), *_asked_twice(app), *_replayed(app, slug)]


def errors_in(log: Path, explained: tuple[str, ...] = ()) -> list[str]:
    """What a server wrote into its log as errors, but for messages that begin in one of these ways.

    What is no line of JSON, such as the address that it says first, is none, but a traceback is.
    """
    found = []
    for line in log.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("Traceback"):
            found.append(f"the log has a bare {line}")
        if not line.startswith("{"):
            continue
        try:
            said = json.loads(line)
        except ValueError:
            # The last words of a server that was killed.
            continue
        is_error = said.get("level") in ("error", "critical")
        if is_error and not str(said["message"]).startswith(explained):
            found.append(f"the log says: {said['message']} {said.get('exception', '')[-1500:]}")
    return found


def _responses(app: AppContext, log: Log, in_hand: InHand) -> list[str]:
    stored: dict[str, list[tuple[str, str]]] = defaultdict(list)
    with app.database.read() as db:
        for token, query, response in db.execute(
            select(SessionRow.token_hash, QueryRow.public_id, Response.response)
            .join(Trial, Trial.session_id == SessionRow.id)
            .join(QueryRow, QueryRow.trial_id == Trial.id)
            .join(Response, Response.query_id == QueryRow.id)
            .order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index)
        ):
            stored[token].append((query, response))
    found = []
    for token, told in log.acknowledged.items():
        there = stored[secret_hash(token)]
        more = [
            answer for answer in there if answer not in told and (token, *answer) not in in_hand
        ]
        lost = [answer for answer in told if answer not in there]
        if lost:
            found.append(f"{len(lost)} acknowledged responses are not stored: {lost[:3]}")
        if more:
            found.append(f"{len(more)} responses are stored that nobody was told of: {more[:3]}")
    return found


def _asked_twice(app: AppContext) -> list[str]:
    with app.database.read() as db:
        twice = db.execute(
            select(QueryRow.trial_id, QueryRow.query_index)
            .where(QueryRow.set_aside_at.is_(None))
            .group_by(QueryRow.trial_id, QueryRow.query_index)
            .having(func.count() > 1)
        ).all()
    return [f"{len(twice)} places of trials have two queries"] if twice else []


def _replayed(app: AppContext, slug: str) -> list[str]:
    differences = sum(len(trial.differences) for trial in replay.replay(app, slug))
    return [f"{differences} queries are not what their history says"] if differences else []
