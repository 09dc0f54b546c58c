"""Tables of queries with responses, preferences, acquired candidates, and events."""

from __future__ import annotations

from collections.abc import Iterator

from sqlalchemy import and_, case, select
from sqlalchemy.orm import Session

from app.storage.models.consents import ConsentRow
from app.storage.models.studies import (
    Acquired,
    Event,
    Participant,
    PlanVersion,
    PreferenceRow,
    QueryRow,
    Response,
    SessionRow,
    Trial,
)
from app.study.plan import Plan

from .table import (
    MODE,
    PARTICIPANT,
    QUERY,
    SESSION,
    STUDY,
    SURENESS,
    TRIAL,
    Column,
    Request,
    Row,
    Table,
    at_trials_of,
    fetch,
    integer,
    moment,
    number,
    of_trials,
    parameters,
    points,
    recording_names,
    recording_of,
    text,
)


def _queries_columns(plan: Plan) -> tuple[Column, ...]:
    return (
        STUDY,
        text("plan_hash", "SHA-256 of the plan, texts and recordings it was answered under."),
        PARTICIPANT,
        SESSION,
        MODE,
        TRIAL,
        text("condition", "Name of the condition that the trial was run under."),
        text("method", "Method that chose the queries."),
        text("environment", "Environment of the candidates."),
        QUERY,
        text(
            "trial_type",
            "random (before the model), model, repeat, attention, filler, or practice.",
        ),
        integer("left_candidate", "Index of the candidate on the left."),
        integer("right_candidate", "Index of the candidate on the right."),
        text("left_recording", "Recording on the left; see recordings.csv."),
        text("right_recording", "Recording on the right; see recordings.csv."),
        *parameters(plan, "left_", "the candidate on the left"),
        *parameters(plan, "right_", "the candidate on the right"),
        text("response", "left, right, skip, or empty while the query is open."),
        integer("chosen_candidate", "Index of the chosen candidate; empty for a skip."),
        text("skip_reason", "Reason given for a skip, where the study asks for one."),
        number("rt", "Time from both videos having begun to play to the response.", "ms"),
        moment("shown_at", "When the server first sent the query."),
        moment("answered_at", "When the server stored the response."),
        text("acquisition", "What chose the pair."),
        integer("seed", "Seed of the proposal."),
        text("engine_version", "Version of the optimiser that made the proposal."),
        text(
            "consent_version",
            "Version of the consent that the participant had agreed to when they answered; of an"
            " open query, that they last agreed to. See consents.csv.",
        ),
    )


def _queries_rows(db: Session, request: Request) -> Iterator[Row]:
    by_candidate = points(db, request)
    names = recording_names(db, request)
    under = case((Response.id.is_(None), SessionRow.plan_id), else_=Response.plan_id)
    statement = of_trials(
        select(
            QueryRow,
            Trial,
            SessionRow,
            Participant.pseudonym,
            PlanVersion.plan_hash,
            Response,
            ConsentRow.consent_version,
        )
        .join(Trial, QueryRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id)
        .join(Participant, SessionRow.participant_id == Participant.id)
        .outerjoin(Response, Response.query_id == QueryRow.id)
        # The version at the time of the response, not the one agreed to later.
        .outerjoin(PlanVersion, PlanVersion.id == under)
        .outerjoin(
            ConsentRow,
            and_(ConsentRow.session_id == SessionRow.id, ConsentRow.plan_id == under),
        )
        .where(QueryRow.set_aside_at.is_(None)),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, QueryRow.query_index)
    for query, trial, row, pseudonym, plan_hash, response, consent in fetch(db, statement):
        chosen = {"left": query.left_candidate, "right": query.right_candidate}
        pressed = response.response if response else None
        yield (
            request.study.slug,
            plan_hash,
            pseudonym,
            row.public_id,
            row.mode,
            trial.trial_index,
            trial.condition,
            trial.method,
            trial.environment,
            query.query_index,
            query.trial_type,
            query.left_candidate,
            query.right_candidate,
            recording_of(names, query.left_recording_id),
            recording_of(names, query.right_recording_id),
            *by_candidate[trial.environment, query.left_candidate],
            *by_candidate[trial.environment, query.right_candidate],
            pressed,
            chosen.get(pressed or ""),
            response.skip_reason if response else None,
            response.rt_ms if response else None,
            query.shown_at,
            response.answered_at if response else None,
            query.acquisition,
            query.seed,
            query.engine_version,
            consent,
        )


def _preferences_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        integer("preference_index", "Number of the preference within the trial, from 0."),
        integer("winner", "Index of the preferred candidate."),
        integer("loser", "Index of the other candidate."),
        text("origin", "answer: pressed; synthesis: made from a skip."),
        integer("query_index", "Query that the preference comes from."),
        integer("drawn_from_query_index", "For a synthesis: query whose choice was drawn."),
    )


def _preferences_rows(db: Session, request: Request) -> Iterator[Row]:
    statement = of_trials(
        select(SessionRow.public_id, Trial.trial_index, PreferenceRow)
        .join(Trial, PreferenceRow.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, PreferenceRow.preference_index)
    for public_id, trial_index, row in fetch(db, statement):
        yield (
            public_id,
            trial_index,
            row.preference_index,
            row.winner,
            row.loser,
            row.origin,
            row.query_index,
            row.drawn_from_query_index,
        )


def _acquired_columns(plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        integer("query_index", "The response after which this was the acquired candidate."),
        integer("candidate", "Index of the acquired candidate: the largest posterior mean."),
        *parameters(plan, "", "the acquired candidate"),
        number("posterior_mean", "Posterior mean of the acquired candidate; none for a knockout."),
        number("posterior_std", "Posterior standard deviation of the same."),
        SURENESS,
    )


def _acquired_rows(db: Session, request: Request) -> Iterator[Row]:
    by_candidate = points(db, request)
    statement = of_trials(
        select(SessionRow.public_id, Trial.trial_index, Trial.environment, Acquired)
        .join(Trial, Acquired.trial_id == Trial.id)
        .join(SessionRow, Trial.session_id == SessionRow.id),
        request,
    ).order_by(SessionRow.id, Trial.trial_index, Acquired.query_index)
    for public_id, trial_index, environment, row in fetch(db, statement):
        yield (
            public_id,
            trial_index,
            row.query_index,
            row.candidate,
            *by_candidate[environment, row.candidate],
            row.posterior_mean,
            row.posterior_std,
            row.sureness,
        )


def _events_columns(_plan: Plan) -> tuple[Column, ...]:
    return (
        SESSION,
        TRIAL,
        QUERY,
        text(
            "event",
            "What happened: playback, focus, fullscreen; left_out where more came than is kept.",
        ),
        text("side", "left or right, where it happened to one video."),
        number("time_ms", "Time since the query appeared.", "ms"),
        text(
            "value", "What the event carries, such as a number of replays, or of events left out."
        ),
    )


def _events_rows(db: Session, request: Request) -> Iterator[Row]:
    statement = (
        select(SessionRow.public_id, Event)
        .join(SessionRow, Event.session_id == SessionRow.id)
        .where(*at_trials_of(request, Event.session_id, Event.trial_index))
        .order_by(SessionRow.id, Event.trial_index, Event.query_index, Event.id)
    )
    for public_id, row in fetch(db, statement):
        yield (
            public_id,
            row.trial_index,
            row.query_index,
            row.event,
            row.side,
            row.time_ms,
            row.value,
        )


QUERIES = Table(
    "queries",
    "One row per query: what was shown, what was pressed.",
    _queries_columns,
    _queries_rows,
)
PREFERENCES = Table(
    "preferences",
    "What the model learnt from, each with its origin.",
    _preferences_columns,
    _preferences_rows,
)
ACQUIRED = Table(
    "acquired", "The acquired candidate after each response.", _acquired_columns, _acquired_rows
)
EVENTS = Table(
    "events",
    "What happened in the browser while queries were on the screen.",
    _events_columns,
    _events_rows,
)
