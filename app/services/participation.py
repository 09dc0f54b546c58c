"""An evaluator's passage through a study. The server alone decides where a session is.

Each use case reads, works out what follows outside any transaction, and then writes once, having
looked again: two tabs, a double click or a retry find that it was done.
"""

from __future__ import annotations

from sqlalchemy import delete

from app.storage.arrivals import Reentry
from app.storage.tables import Event, SessionRow
from app.study import protocol
from app.study.protocol import Stage
from app.study.stages import Device

from . import consents, playlist, sessions, studies, trials
from . import state as session_state
from .state import State
from .studio import Studio
from .tokens import form_token, is_secret, new_secret, receipt_code, receipt_hash, secret_hash


def current(studio: Studio, token: str) -> State:
    """Where the session is."""
    with studio.database.read() as session:
        return session_state.describe(studio, session, sessions.find(studio, session, token))


def consent(studio: Studio, token: str, version: str, *, successor: str | None = None) -> State:
    """Agree to the consent of `version`. Raises StaleConsent if the text is another one now.

    successor: the token that takes this one's place at the first consent, with its own receipt.
    Before consent somebody may have planted a token that they know in the browser.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        changed = consents.due(session, row)
        if changed is not None:
            is_again = row.stage != Stage.CONSENT
            consents.renew(row, changed, version)
            if is_again:
                row.last_seen_at = studio.now()
                consents.agree(session, row, version, row.last_seen_at)
                return session_state.describe(studio, session, row)
        now_in_force = consents.text(studies.stored_texts(row.plan)[row.language])["version"]
        event = protocol.Consented(version=version, current_version=now_in_force)
        sessions.advance(studio, row, event)
        consents.agree(session, row, version, studio.now())
        if successor is not None:
            row.token_hash = secret_hash(successor)
            row.receipt_hash = receipt_hash(receipt_code(successor))
            session.execute(delete(Reentry).where(Reentry.session_id == row.id))
        state = session_state.describe(studio, session, row)
        first = trials.first_query(studio, row)
        coming = [*playlist.test_clips(studio, row), first.left, first.right]
        coming.extend(playlist.clips(studio, row))
    studio.proposer.render(coming)
    return state


def successor_of(studio: Studio, token: str, browser: str) -> str:
    """The token that takes this one's place when its browser agrees.

    browser: the secret in a cookie of the browser, which with the server's own makes it the same
    for a form that is sent twice.
    """
    if not is_secret(browser):
        return new_secret()
    return form_token(studio.secret.key("tokens at consent"), "successor", browser, token)


def go_on(
    studio: Studio, token: str, device: Device | None = None, *, leaving: str | None = None
) -> State:
    """Leave a page that only has to be left. Raises a ProtocolError that says what is missing.

    leaving: the stage to be left, where it is known. If it was left before, nothing is done.
    """
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        if leaving is not None and leaving != row.stage:
            return session_state.describe(studio, session, row)
        checked = row.stage == Stage.DEVICE_CHECK
        watched = len(playlist.watched(row)) if row.stage == Stage.FAMILIARISATION else 0
        event = protocol.Continued(at=studio.now(), watched=watched, device=device)
        sessions.advance(studio, row, event)
        if checked and device is not None:
            session.add_all(_measures(row, device))
        trials.arrive(studio, session, row)
        return session_state.describe(studio, session, row)


def screen_out(studio: Studio, token: str) -> State:
    """End a session whose person has no device that passes the check. Raises OutOfOrder."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        sessions.advance(studio, row, protocol.ScreenedOut())
        return session_state.describe(studio, session, row)


def _measures(row: SessionRow, device: Device) -> list[Event]:
    """What the device check has measured, kept among the events of no trial."""
    measured = {
        "device_width_px": device.width_px,
        "device_mbit_s": device.mbit_s,
        "device_played": int(device.played),
    }
    return [
        Event(
            session_id=row.id,
            trial_index=consents.NO_TRIAL,
            query_index=consents.NO_TRIAL,
            event=name,
            time_ms=0.0,
            value=None if value is None else f"{value:g}",
        )
        for name, value in measured.items()
    ]


def watch(studio: Studio, token: str, index: int) -> State:
    """A video of the familiarisation was watched to its end. The same again changes nothing."""
    with studio.database.write() as session:
        row = sessions.find(studio, session, token, to_write=True)
        if row.stage != Stage.FAMILIARISATION:
            raise protocol.OutOfOrder(Stage(row.stage), "no video is to be watched now")
        playlist.mark_watched(row, index)
        row.last_seen_at = studio.now()
        return session_state.describe(studio, session, row)
