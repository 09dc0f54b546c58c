"""Who comes in: what a newcomer is shown, and how a session begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from types import MappingProxyType
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.failure_counter import FailureContext, Kind
from app.services.runtime.errors import (
    ForbiddenError,
    SignedLinkError,
    SignInRequiredError,
    StudyNotOpenError,
    StudyPausedError,
    UndeclaredIdentifierError,
)
from app.services.runtime.ids import (
    form_token,
    is_secret,
    new_pseudonym,
    new_secret,
    receipt_code,
    receipt_hash,
    secret_hash,
)
from app.services.sessions import completion, consents, failure_return, lookup
from app.services.sessions import state_view as session_state
from app.services.sessions.state_view import State
from app.services.studies import repository
from app.services.studies.session_modes import LIVE, PILOT, PREVIEW, SIMULATED
from app.storage.models.studies import Participant, SessionRow, Study
from app.study import assignment
from app.study import recruitment as rules
from app.study.folder import WELCOME
from app.study.identifiers import Given
from app.study.plan import Plan
from app.study.protocol import Progress

from . import capacity, entry_links, pilot_links, re_entry, session_start_limit


@dataclass(frozen=True)
class LandingPage:
    """What somebody who has no session yet is shown; nothing is kept of them.

    welcome: what comes before the consent, where the study has it.
    """

    study: State
    language: str
    languages: Sequence[str]
    welcome: str | None
    consent: Mapping[str, Any]
    trials: int
    queries: int

    @property
    def title(self) -> str:
        return str(self.study["title"])


def entrance(
    app: AppContext,
    slug: str,
    language: str | None = None,
    *,
    entry: str | None = None,
    ids: Mapping[str, str] = MappingProxyType({}),
    mode: str = LIVE,
) -> LandingPage:
    """The study's consent. Raises NotFoundError, StudyNotOpenError, StudyFullError,
    TooManyBegunError or EntryLinkError.

    entry: the token of a link that lets one person in, where the study wants one, or of the link of
    its pilot. ids: what the
    link says of the person. mode: of the session that is to begin; whether the caller may begin it
    has been asked before.
    """
    study = repository.find(app, slug)
    failure_return.remember(slug, study.plan)
    _require_open(study, mode)
    with app.database.read() as db:
        _require_no_crowd(app, db, study, mode, ids)
        if mode == LIVE:
            capacity.require(db, study, LIVE, app.now())
            entry_links.require_unused(db, study, entry)
        elif mode == PILOT:
            pilot_links.require_link(db, study, entry)
    language = _language(study.plan, language)
    welcome = study.texts[language].get(WELCOME)
    return LandingPage(
        study=session_state.study_of(study.plan, slug, language),
        language=language,
        languages=study.plan.languages,
        welcome=welcome and session_state.rendered(welcome),
        consent=consents.text(study.texts[language]),
        trials=len(assignment.conditions_on(study.plan, study.conditions_off))
        * study.plan.trials_per_condition,
        queries=study.plan.shown_per_trial,
    )


def begun(app: AppContext, slug: str, arrival: str, browser: str) -> str | None:
    """The token of the session that the consent form of this value has begun; None if none yet.

    arrival, browser: as `start` has them.
    """
    token = _token_of_form(app, slug, arrival, browser)
    if token is None:
        return None
    with app.database.read() as db:
        return token if _session_of(app, db, token) is not None else None


def start(
    app: AppContext,
    slug: str,
    *,
    external_ids: Mapping[str, str] | None = None,
    mode: str = LIVE,
    language: str | None = None,
    by_experimenter: bool = False,
    entry: str | None = None,
    after: str | None = None,
    arrival: str = "",
    is_signed: bool = False,
    browser: str = "",
) -> tuple[str, State]:
    """Begin a session: a token, shown this once, and its state.

    An experimenter's program is taken back into the session of the ids that it gives.

    after: the token of a session that was left for too long, where the study lets one begin anew.
    arrival: the random value of the consent form that begins the session; sent again, the form
    leads into the session that it began. browser: the secret in a cookie of the browser that sends
    it; a form that another browser sends leads elsewhere. is_signed: whether the platform's
    signature on the ids was verified.
    Raises AlreadyTakenPartError where the study does not let a person in twice, KnownPersonError
    where somebody of these ids has begun, EntryLinkError where the study wants a link for each
    person and this one lets nobody in, and TooManyBegunError.
    """
    if mode in (PREVIEW, SIMULATED) and not by_experimenter:
        raise ForbiddenError(
            f"expected an experimenter of the study, signed in or with an API token: nobody else"
            f" may begin a session of the mode {mode!r}"
        )
    token = _token_of_form(app, slug, arrival, browser) or new_secret()
    seed = app.seed()
    with app.database.write() as db:
        # One arrival at a time: the same person in two windows is seen to be the same.
        db.execute(select(Study.id).where(Study.slug == slug).with_for_update())
        begun_already = _session_of(app, db, token)
        if begun_already is not None:
            return token, session_state.describe(app, db, begun_already)
        study = repository.read(db, slug)
        if mode == LIVE and not by_experimenter:
            _require_signed(study.plan, is_signed=is_signed)
        given = _given(study.plan, external_ids or {})
        ids = given.ids
        joined = _left_behind(app, db, study, after) if after is not None else None
        if joined is None and by_experimenter:
            joined = re_entry.earlier_session(db, study, mode, ids)
            if joined is not None:
                re_entry.refuse_if_blocked(db, study.plan, joined, is_proven=True)
                if re_entry.may_go_on(app, study.plan, joined):
                    re_entry.take_back(app, db, joined, token, is_full=True)
                    db.flush()
                    return token, session_state.describe(app, db, joined)
        elif joined is None:
            # An id alone joins nobody: who brings it may be anybody.
            re_entry.refuse_if_known(app, db, study, ids)
        _require_open(study, mode)
        now = app.now()
        if mode == PREVIEW or not by_experimenter:
            _require_no_crowd(app, db, study, mode, ids)
        if mode == LIVE:
            capacity.require(db, study, mode, now)
            entry_links.use(db, study, entry, now)
        elif mode == PILOT and not by_experimenter:
            pilot_links.require_link(db, study, entry)
        participant_id = joined.participant_id if joined is not None else None
        if participant_id is None:
            participant = Participant(
                study_id=study.id, pseudonym=new_pseudonym("P"), created_at=now
            )
            db.add(participant)
            db.flush()
            participant_id = participant.id
        re_entry.write_ids(app, db, participant_id, ids)
        order_index, conditions = _assign(db, study, mode, seed, now)
        session = SessionRow(
            public_id=new_pseudonym("S"),
            study_id=study.id,
            plan_id=study.plan_id,
            participant_id=participant_id,
            token_hash=secret_hash(token),
            receipt_hash=receipt_hash(receipt_code(token)),
            mode=mode,
            platform=_platform(study.plan),
            language=_language(study.plan, language),
            seed=seed,
            order_index=order_index,
            trial_conditions=list(conditions),
            started_at=now,
            last_seen_at=now,
            expires_at=now + timedelta(days=study.plan.session_expires_after_days),
        )
        session_state.place(session, Progress.start())
        db.add(session)
        db.flush()
        state = session_state.describe(app, db, session)
    if given.unfilled and mode == LIVE:
        app.failures.note(Kind.UNFILLED, FailureContext(slug=slug))
    return token, state


def _token_of_form(app: AppContext, slug: str, arrival: str, browser: str) -> str | None:
    """None where two people could have thought of these values."""
    if not (is_secret(arrival) and is_secret(browser)):
        return None
    key = app.secret.key("sessions of consent forms")
    return form_token(key, slug, browser, arrival)


def _session_of(app: AppContext, db: Session, token: str) -> SessionRow | None:
    try:
        return lookup.find(app, db, token, even_expired=True)
    except SignInRequiredError:
        return None


def _left_behind(
    app: AppContext, db: Session, study: repository.StudyInfo, token: str
) -> SessionRow | None:
    """The session of `token`, which its study lets one begin anew: it is the same participant's."""
    session = _session_of(app, db, token)
    if session is None:
        return None
    plan = repository.stored_plan(session.plan)
    is_left = plan.resume.policy == "restart" and lookup.is_too_old(plan, session, app.now())
    return session if is_left and session.study_id == study.id else None


def _given(plan: Plan, came: Mapping[str, str]) -> Given:
    """What is kept of the identifiers that came.

    Raises UndeclaredIdentifierError for a key that the plan's platform does not add to its links,
    and IdsRefusedError.
    """
    declared = plan.recruitment.parameters
    names = {name.casefold() for name in declared}
    unknown = [key for key in came if key.casefold() not in names]
    if unknown:
        known = f"identifiers among {', '.join(declared)}" if declared else "no identifier"
        raise UndeclaredIdentifierError(
            f"expected {known} (the plan's platform is {plan.recruitment.platform}),"
            f" got {unknown[0]!r}"
        )
    return completion.read(plan, came.items())


def _platform(plan: Plan) -> str | None:
    name = plan.recruitment.platform
    return None if name == rules.NO_PLATFORM else name


def _require_signed(plan: Plan, *, is_signed: bool) -> None:
    if plan.recruitment.signed_links and not is_signed:
        raise SignedLinkError(
            "expected somebody who comes by a link that the platform signed: by the API nobody but"
            " experimenters begins a session of this study"
        )


def _require_open(study: repository.StudyInfo, mode: str) -> None:
    if mode in (PREVIEW, SIMULATED):
        return
    if mode == PILOT and study.status == repository.DRAFT:
        return
    if study.status != repository.OPEN:
        is_draft = study.status == repository.DRAFT
        what = "is not open yet" if is_draft else "is closed"
        raise StudyNotOpenError(f"the study {study.slug!r} {what}", is_draft=is_draft)
    if study.paused_at is not None:
        raise StudyPausedError(f"the study {study.slug!r} is paused and lets nobody in just now")


def _require_no_crowd(
    app: AppContext, db: Session, study: repository.StudyInfo, mode: str, ids: Mapping[str, str]
) -> None:
    is_named = rules.person(study.plan.recruitment, ids) is not None
    limit = app.settings.begun_per_hour
    session_start_limit.require(db, study, limit, app.now(), mode=mode, is_named=is_named)


def _language(plan: Plan, wanted: str | None) -> str:
    return wanted if wanted in plan.languages else plan.default_language


def _assign(
    db: Session, study: repository.StudyInfo, mode: str, seed: int, now: datetime
) -> tuple[int, tuple[int, ...]]:
    """The order of conditions that the fewest have finished or are in the middle of."""
    plan = study.plan
    orders = assignment.plan_orders(plan)
    taken = capacity.by_order(db, study, mode, now)
    counts = [taken[index] for index in range(len(orders))]
    chosen = assignment.choose_order(counts, np.random.default_rng([seed, 103]))
    trials = assignment.trial_conditions(plan, orders[chosen])
    switched_on = assignment.conditions_on(plan, study.conditions_off)
    return chosen, tuple(index for index in trials if index in switched_on)
