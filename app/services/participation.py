"""An evaluator's passage through a study. The server alone decides where a session is.

Each use case reads, works out what follows outside any transaction, and then writes once, having
looked again: two tabs, a double click or a retry find that it was done.
"""

from __future__ import annotations

from app.study import protocol
from app.study.protocol import Stage

from . import playlist, sessions, trials
from . import state as session_state
from .state import State
from .studio import Studio


def current(studio: Studio, token: str) -> State:
    """Where the session is."""
    with studio.database.read() as session:
        return session_state.describe(studio, session, sessions.find(studio, session, token))


def consent(studio: Studio, token: str, version: str) -> State:
    """Agree to the consent of `version`. Raises StaleConsent if the text is another one now."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        written = row.plan.texts[row.language]
        now_in_force = session_state.consent_text(written)["version"]
        event = protocol.Consented(version=version, current_version=now_in_force)
        sessions.advance(studio, row, event)
        row.consent_version = version
        row.consented_at = studio.now()
        state = session_state.describe(studio, session, row)
        first = trials.first_query(studio, row)
        coming = [first.left, first.right, *playlist.clips(studio, row)]
    studio.proposer.render(coming)
    return state


def go_on(studio: Studio, token: str) -> State:
    """Leave a page that only has to be left. Raises OutOfOrder, or BreakNotOver."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        watched = len(playlist.watched(row)) if row.stage == Stage.FAMILIARISATION else 0
        sessions.advance(studio, row, protocol.Continued(at=studio.now(), watched=watched))
        trials.arrive(studio, session, row)
        return session_state.describe(studio, session, row)


def watch(studio: Studio, token: str, index: int) -> State:
    """A video of the familiarisation was watched to its end. The same again changes nothing."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        if row.stage != Stage.FAMILIARISATION:
            raise protocol.OutOfOrder(Stage(row.stage), "no video is to be watched now")
        playlist.mark_watched(row, index)
        row.last_seen_at = studio.now()
        return session_state.describe(studio, session, row)
