"""Admission to a study: the data of the landing page, and the start of a session."""

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
from app.study.query_settings import draw_reason_order
from app.study.stages import Progress

from . import (
    capacity,
    entry_links,
    pilot_links,
    preview_tokens,
    re_entry,
    session_start_limit,
)

#: Which draw of the session's seed orders the reasons of a skip.
_REASON_DRAW = 109


@dataclass(frozen=True)
class LandingPage:
    """The data of the consent page before a session exists. Nothing about the reader is stored.

    welcome: the HTML shown before the consent, or None. trials, queries: how many trials there are,
    and how many queries each has.
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
        """The study's title in the page's language."""
        return str(self.study["title"])


def landing_page(
    app: AppContext,
    slug: str,
    language: str | None = None,
    *,
    entry: str | None = None,
    ids: Mapping[str, str] = MappingProxyType({}),
    mode: str = LIVE,
) -> LandingPage:
    """The data of a study's landing page in the given language.

    entry: the token of a single-use entry link or of the pilot link, if the study or the mode needs
    one. ids: the platform ids of the link. mode: that of the session to be started; the caller has
    checked that it may be.

    Raises NotFoundError, StudyNotOpenError, StudyPausedError, StudyFullError, TooManyBegunError or
    EntryLinkError.
    """
    study = repository.find(app, slug)
    failure_return.remember(slug, study.plan)
    _require_open(study, mode)
    with app.database.read() as db:
        _require_start_allowed(app, db, study, mode, ids)
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


def token_of_started_session(app: AppContext, slug: str, arrival: str, browser: str) -> str | None:
    """The token of the session that this consent form has started; None if it has not.

    arrival, browser: as for `start`.
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
    credential: str = "",
) -> tuple[str, State]:
    """Start a session; return its token, of which only the hash is stored, and its state.

    When an experimenter's program passes ids that have a session, that session is resumed instead.

    external_ids: platform ids of the participant. by_experimenter: whether an authenticated
    experimenter makes the call. entry: the token of an entry or pilot link. after: the token of a
    session that became too old to resume, where the study allows a restart; the participant stays
    the same. arrival: the random value of the consent form; sending the form again returns the
    session that it started. browser: the secret in a cookie of the sending browser, so that the
    form sent from another browser has another token. is_signed: whether the platform's signature on
    the ids was verified. credential: the experimenter's sign-in or API token, for a preview.

    Raises AlreadyTakenPartError if the study does not admit a person twice, KnownPersonError if a
    session with these ids exists, EntryLinkError if the study needs an entry link and this one is
    not valid, TooManyBegunError, StudyFullError, StudyNotOpenError, StudyPausedError,
    SignedLinkError, UndeclaredIdentifierError, IdsRefusedError, or ForbiddenError for a mode that
    needs an experimenter.
    """
    if mode in (PREVIEW, SIMULATED) and not by_experimenter:
        raise ForbiddenError(
            f"expected an experimenter of the study, signed in or with an API token: nobody else"
            f" may begin a session of the mode {mode!r}"
        )
    prefix = preview_tokens.prefix_for(credential) if mode == PREVIEW else ""
    token = prefix + (_token_of_form(app, slug, arrival, browser) or new_secret())
    seed = app.seed()
    with app.database.write() as db:
        # Arrivals are serialised, so that the same person in two windows is recognised.
        db.execute(select(Study.id).where(Study.slug == slug).with_for_update())
        started_already = _session_of(app, db, token)
        if started_already is not None:
            return token, session_state.describe(app, db, started_already)
        study = repository.read(db, slug)
        if mode == LIVE and not by_experimenter:
            _require_signed(study.plan, is_signed=is_signed)
        given = _given(study.plan, external_ids or {})
        ids = given.ids
        joined = _restartable_session(app, db, study, after) if after is not None else None
        if joined is None and by_experimenter:
            joined = re_entry.earlier_session(db, study, mode, ids)
            if joined is not None:
                re_entry.refuse_if_blocked(db, study.plan, joined, is_proven=True)
                if re_entry.may_resume(app, study.plan, joined):
                    re_entry.issue_token(app, db, joined, token, is_full=True)
                    db.flush()
                    return token, session_state.describe(app, db, joined)
        elif joined is None:
            # A platform id is no proof of identity, so it does not lead into a session.
            re_entry.refuse_if_known(app, db, study, ids)
        _require_open(study, mode)
        now = app.now()
        if mode == PREVIEW or not by_experimenter:
            _require_start_allowed(app, db, study, mode, ids)
        if mode == LIVE:
            capacity.require(db, study, mode, now)
            entry_links.redeem(db, study, entry, now)
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
            skip_reason_order=_draw_reason_order(study.plan, seed),
            started_at=now,
            last_seen_at=now,
            expires_at=now + timedelta(days=study.plan.session_expires_after_days),
        )
        session_state.store_progress(session, Progress.start())
        db.add(session)
        db.flush()
        state = session_state.describe(app, db, session)
    if given.unfilled and mode == LIVE:
        app.failures.buffer(Kind.UNFILLED, FailureContext(slug=slug))
    return token, state


def _token_of_form(app: AppContext, slug: str, arrival: str, browser: str) -> str | None:
    """The token that the form leads to; None if one of the values is not random enough."""
    if not (is_secret(arrival) and is_secret(browser)):
        return None
    key = app.secret.key("sessions of consent forms")
    return form_token(key, slug, browser, arrival)


def _session_of(app: AppContext, db: Session, token: str) -> SessionRow | None:
    """The session of this token, expired or not; None if there is none."""
    try:
        return lookup.find(app, db, token, even_expired=True)
    except SignInRequiredError:
        return None


def _restartable_session(
    app: AppContext, db: Session, study: repository.StudyInfo, token: str
) -> SessionRow | None:
    """The session of `token` if it is too old to resume and its study allows a restart."""
    session = _session_of(app, db, token)
    if session is None:
        return None
    plan = repository.stored_plan(session.plan)
    is_left = plan.resume.policy == "restart" and lookup.is_too_old(plan, session, app.now())
    return session if is_left and session.study_id == study.id else None


def _given(plan: Plan, came: Mapping[str, str]) -> Given:
    """The ids to be stored, out of those that came.

    Raises UndeclaredIdentifierError for a key that the plan's platform does not add to its links,
    and IdsRefusedError.
    """
    declared = plan.recruitment.link_parameters
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


def _require_start_allowed(
    app: AppContext, db: Session, study: repository.StudyInfo, mode: str, ids: Mapping[str, str]
) -> None:
    is_named = rules.person(study.plan.recruitment, ids) is not None
    limit = app.settings.begun_per_hour
    session_start_limit.require(db, study, limit, app.now(), mode=mode, is_named=is_named)


def _language(plan: Plan, wanted: str | None) -> str:
    return wanted if wanted in plan.languages else plan.default_language


def _draw_reason_order(plan: Plan, seed: int) -> list[str] | None:
    """In which order a session's pages list the reasons of a skip; None without reasons."""
    rng = np.random.default_rng([seed, _REASON_DRAW])
    skips = (condition.skip for condition in plan.conditions)
    return list(draw_reason_order(skips, rng)) or None


def _assign(
    db: Session, study: repository.StudyInfo, mode: str, seed: int, now: datetime
) -> tuple[int, tuple[int, ...]]:
    """The index of the order of conditions with the fewest finished or active sessions, and the
    condition of each of the session's trials.
    """
    plan = study.plan
    orders = assignment.plan_orders(plan)
    taken = capacity.by_order(db, study, mode, now)
    counts = [taken[index] for index in range(len(orders))]
    chosen = assignment.choose_order(counts, np.random.default_rng([seed, 103]))
    trials = assignment.trial_conditions(plan, orders[chosen])
    switched_on = assignment.conditions_on(plan, study.conditions_off)
    return chosen, tuple(index for index in trials if index in switched_on)
