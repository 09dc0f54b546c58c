"""The part of a report on the design of the study."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.pbbo import Settings as OptimizerSettings
from app.services.export.table import Request, sessions_of
from app.services.studies.repository import StudyInfo
from app.storage.models.studies import Candidate, Recording, SessionRow
from app.study.assignment import plan_orders
from app.study.plan import Plan

from .document import Block, Heading, Paragraph, Table, many

#: Settings that every optimiser with a model uses.
_OF_ALL = frozenset({"signal_variance", "scale_candidates"})


def design(db: Session, study: StudyInfo) -> Iterator[Block]:
    """The course of a session, the conditions, and the candidates and recordings."""
    plan = study.plan
    yield Heading("Design")
    yield Paragraph(" ".join(_course(plan)))
    yield Table(
        "Conditions",
        ("Condition", "Method", "Environment", "Skip button", "Settings"),
        [
            (
                condition.name,
                condition.method,
                condition.environment,
                plan.text(condition.skip.label, plan.default_language)
                if condition.skip
                else "none",
                json.dumps(condition.optimizer_settings, sort_keys=True)
                if condition.optimizer_settings
                else "default",
            )
            for condition in plan.conditions
        ],
    )
    yield Table(
        "Settings of the optimisers, also where the plan leaves them out",
        ("Condition", "Setting", "Value"),
        list(_settings(plan)),
    )
    yield Table(
        "Candidates and recordings",
        ("Environment", "Candidates", "Recordings", "With a score"),
        list(_space(db, study)),
    )
    yield Table(
        "Parameters of a candidate",
        ("Parameter", "Meaning", "Unit", "Least", "Largest"),
        list(_parameters(db, study)),
    )


def _course(plan: Plan) -> Iterator[str]:
    """Sentences that describe a session, as in a methods section."""
    shown = plan.shown_per_trial
    yield (
        f"Each session has {many(plan.trials, 'trial')} of"
        f" {many(plan.queries_per_trial, 'two-choice query', 'two-choice queries')},"
        f" {many(plan.trials_per_condition, 'trial')} for each of"
        f" {many(len(plan.conditions), 'condition')}; each trial begins with a fresh model."
    )
    if plan.stop is not None:
        yield (
            f"A trial ends earlier, after the first response by which its model is"
            f" {plan.stop.sure * 100:g} % sure that no candidate is better than the acquired one by"
            f" more than {plan.stop.within * 100:g} % of the range of the latent function."
        )
    orders = len(plan_orders(plan))
    if plan.order == "counterbalanced":
        yield f"The order of the conditions is counterbalanced over {many(orders, 'order')}."
    else:
        yield "The order of the conditions is the same for everybody."
    yield (
        "Which of the two candidates stands on the left, and which recording of a candidate is"
        " shown, is drawn at random."
    )
    if plan.blocks == "environment":
        yield "Trials of one environment are kept together."
    if plan.break_s:
        yield f"Between trials there is a break of {plan.break_s} s."
    if plan.familiarisation.videos:
        yield (
            f"Beforehand, {many(plan.familiarisation.videos, 'video')} drawn at random can be"
            f" watched, of which {plan.familiarisation.required} must be."
        )
    if plan.practice.queries:
        pairs = many(plan.practice.queries, "pair")
        yield f"{pairs} are for practice, and no model learns from them."
    if shown > plan.queries_per_trial:
        learns = "learns" if plan.checks.in_model else "does not learn"
        yield (
            f"A trial also shows {many(plan.repeats_per_trial, 'repeat')} with the sides swapped"
            f" and {many(plan.attention_per_trial, 'attention check')}; the model {learns} from"
            " them."
        )
    for when, items in (
        ("After each trial", plan.questionnaires.after_trial),
        ("At the end", plan.questionnaires.end),
    ):
        if items:
            names = ", ".join(f"{item.name} ({item.type})" for item in items)
            yield f"{when} a questionnaire asks for {names}."
    if plan.reward is not None:
        yield f"A session is paid with {plan.reward.amount:g} {plan.reward.currency}."


def _settings(plan: Plan) -> Iterator[tuple[str, ...]]:
    """Rows by condition and setting. Those of a method that a condition does not have are none."""
    for condition in plan.conditions:
        if condition.method == "knockout":
            continue
        own = condition.method == "pbpo-threshold"
        every = OptimizerSettings.from_mapping(condition.optimizer_settings).to_mapping()
        for name, value in every.items():
            if name.startswith("threshold_") == own or name in _OF_ALL:
                yield condition.name, name, json.dumps(value)


def orders_given(db: Session, request: Request) -> Table:
    """How many of the sessions that consented had the conditions in which order."""
    conditions = request.study.plan.conditions
    statement = select(SessionRow.trial_conditions).where(
        SessionRow.consented_at.is_not(None), *sessions_of(request)
    )
    counted = Counter(tuple(given) for given in db.scalars(statement))
    rows = [
        (", ".join(conditions[index].name for index in given), str(number))
        for given, number in sorted(counted.items())
    ]
    return Table("Orders of conditions that were given", ("Order", "Sessions"), rows)


def _space(db: Session, study: StudyInfo) -> Iterator[tuple[str, ...]]:
    statement = (
        select(
            Candidate.environment,
            func.count(Candidate.id.distinct()),
            func.count(Recording.id),
            func.count(Recording.score),
        )
        .join(Recording, Recording.candidate_id == Candidate.id)
        .where(Candidate.study_id == study.id)
        .group_by(Candidate.environment)
        .order_by(Candidate.environment)
    )
    for environment, *numbers in db.execute(statement):
        yield environment, *map(str, numbers)


def _parameters(db: Session, study: StudyInfo) -> Iterator[tuple[str, ...]]:
    held = db.scalars(select(Candidate.parameters).where(Candidate.study_id == study.id)).all()
    plan = study.plan
    for parameter in plan.parameters:
        values = [row[parameter.name] for row in held]
        yield (
            parameter.name,
            plan.text(parameter.label, plan.default_language) if parameter.label else "",
            parameter.unit or "",
            f"{min(values):g}" if values else "",
            f"{max(values):g}" if values else "",
        )
