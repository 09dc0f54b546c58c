"""Use cases that move a session from stage to stage: consent, continue, screen-out.

Each reads and checks the session under a lock in one transaction, so a second tab, a double click
or a retry finds the step done.
"""

from __future__ import annotations

from sqlalchemy import delete

from app.services.context import AppContext
from app.services.proposals import box_steps
from app.services.runtime.ids import (
    form_token,
    is_secret,
    new_secret,
    receipt_code,
    receipt_hash,
    secret_hash,
)
from app.services.studies import repository
from app.storage.models.arrivals import Reentry
from app.storage.models.studies import Event, SessionRow
from app.study import stages
from app.study.stage_settings import Device
from app.study.stages import Stage

from . import box_queries, box_settling, consents, familiarisation, lookup, shared_next, trial_start
from . import state_view as session_state
from .state_view import State


def current(app: AppContext, token: str) -> State:
    """The state of the session.

    In a study whose videos are made by machines, recordings that exist by now are bound first.
    """
    with app.database.read() as db:
        session = lookup.find(app, db, token)
        if not box_settling.is_over_space(session):
            return session_state.describe(app, db, session)
    box_settling.settle(app, token)
    with app.database.read() as db:
        return session_state.describe(app, db, lookup.find(app, db, token))


def consent(app: AppContext, token: str, version: str, *, successor: str | None = None) -> State:
    """Agree to version `version` of the consent. Raises StaleConsent if the text has changed.

    successor: the token, with its own receipt code, that replaces this one at the first consent.
    Before the consent, an attacker may have planted a token that they know in the browser.
    """
    with app.database.read() as db:
        if repository.stored_plan(lookup.find(app, db, token).plan).has_ranges:
            box_steps.load()
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        changed = consents.due(db, session)
        if changed is not None:
            is_again = session.stage != Stage.CONSENT
            consents.renew(session, changed, version)
            if is_again:
                session.last_seen_at = app.now()
                consents.agree(db, session, version, session.last_seen_at)
                return session_state.describe(app, db, session)
        now_in_force = consents.text(repository.stored_texts(session.plan)[session.language])[
            "version"
        ]
        event = stages.Consented(version=version, current_version=now_in_force)
        lookup.advance(app, session, event)
        consents.agree(db, session, version, app.now())
        if successor is not None:
            session.token_hash = secret_hash(successor)
            session.receipt_hash = receipt_hash(receipt_code(successor))
            db.execute(delete(Reentry).where(Reentry.session_id == session.id))
        state = session_state.describe(app, db, session)
        if repository.stored_plan(session.plan).has_ranges:
            box_queries.ask_first_ahead(app, db, session, trial_start.first_spec(session))
            return state
        recordings = [
            *familiarisation.device_check_videos(app, session),
            *trial_start.prepare_first(app, db, session),
            *familiarisation.videos(app, session),
        ]
    app.proposer.render(recordings)
    return state


def successor_of(app: AppContext, token: str, browser: str) -> str:
    """The token that replaces this one at the consent.

    browser: the secret in the browser's cookie. With it the token is derived, so a form that is
    sent twice gets the same one; otherwise it is random.
    """
    if not is_secret(browser):
        return new_secret()
    return form_token(app.secret.key("tokens at consent"), "successor", browser, token)


def continue_session(
    app: AppContext, token: str, device: Device | None = None, *, leaving: str | None = None
) -> State:
    """Leave a page that needs no input. Raises a ProtocolError that says what is missing.

    device: the measurements of the device check, at that stage. leaving: the stage that the page
    shows; if the session has left it, nothing is changed.
    """
    return shared_next.computing(app, lambda: _continue(app, token, device, leaving))


def _continue(app: AppContext, token: str, device: Device | None, leaving: str | None) -> State:
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        if leaving is not None and leaving != session.stage:
            return session_state.describe(app, db, session)
        checked = session.stage == Stage.DEVICE_CHECK
        watched = (
            len(familiarisation.watched(session)) if session.stage == Stage.FAMILIARISATION else 0
        )
        event = stages.Continued(at=app.now(), watched=watched, device=device)
        lookup.advance(app, session, event)
        if checked and device is not None:
            db.add_all(_measures(session, device))
        trial_start.enter_stage(app, db, session)
        return session_state.describe(app, db, session)


def screen_out(app: AppContext, token: str) -> State:
    """End a session whose device does not pass the check. Raises OutOfOrder."""
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        lookup.advance(app, session, stages.ScreenedOut())
        return session_state.describe(app, db, session)


def _measures(session: SessionRow, device: Device) -> list[Event]:
    """The measurements of the device check as events of no trial."""
    measured = {
        "device_width_px": device.width_px,
        "device_mbit_s": device.mbit_s,
        "device_played": int(device.played),
    }
    return [
        Event(
            session_id=session.id,
            trial_index=consents.NO_TRIAL,
            query_index=consents.NO_TRIAL,
            event=name,
            time_ms=0.0,
            value=None if value is None else f"{value:g}",
        )
        for name, value in measured.items()
    ]


def watch(app: AppContext, token: str, index: int) -> State:
    """Record that a familiarisation video was watched to the end.

    A repeated call changes nothing.
    """
    with app.database.write() as db:
        session = lookup.find(app, db, token, to_write=True)
        if session.stage != Stage.FAMILIARISATION:
            raise stages.OutOfOrder(Stage(session.stage), "no video is to be watched now")
        familiarisation.mark_watched(session, index)
        session.last_seen_at = app.now()
        return session_state.describe(app, db, session)
