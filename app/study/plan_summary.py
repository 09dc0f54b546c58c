"""A summary of a plan in sentences, for readers who do not read its file."""

from __future__ import annotations

from collections.abc import Iterator

from .environments import Environment
from .plan import Plan
from .recruitment import NO_PLATFORM
from .search_space import LOG


def in_words(plan: Plan) -> list[str]:
    """The course of a session, in order, and how participants are recruited."""
    return [*_session(plan), *_people(plan)]


def _session(plan: Plan) -> Iterator[str]:
    if plan.device_check is not None:
        yield "After the consent, the device is checked: who does not pass may try again."
    each = " of each block" if plan.blocks == "environment" else ""
    videos = plan.familiarisation
    if videos.videos:
        needed = f", {videos.required} of them to their end" if videos.required else ""
        yield f"Before the first trial{each}, {_many(videos.videos, 'video')} to watch{needed}."
    if plan.practice.queries:
        yield (
            f"{_many(plan.practice.queries, 'pair')} to learn the page by; the answers reach no"
            " model."
        )
    yield (
        f"{_many(plan.trials, 'trial')}: each of {_many(len(plan.conditions), 'condition')}"
        f" {_times(plan.trials_per_condition)}, {_order(plan)}."
    )
    yield from _pairs(plan)
    yield from _shared_models(plan)
    yield from _machines(plan)
    checks = []
    if plan.repeats_per_trial:
        checks.append(f"{_many(plan.repeats_per_trial, 'earlier pair')} again with sides swapped")
    if plan.attention_per_trial:
        checks.append(f"{_many(plan.attention_per_trial, 'pair')} of a known bad and a known good")
    if checks:
        yield f"Between them, as checks: {' and '.join(checks)}."
    question = plan.query.question
    if question is not None:
        yield f"The question is “{plan.text(question, plan.default_language)}”."
    if plan.query.watch_once:
        yield "The buttons open once both videos were seen to their end."
    if plan.query.undo_s:
        yield f"For {plan.query.undo_s} s the last answer can be taken back."
    if plan.trials > 1:
        rest = f"{plan.break_s} s of rest" if plan.break_s else "No rest"
        yield f"{rest} between trials."
    for items, when in (
        (plan.questionnaires.after_trial, "After each trial"),
        (plan.questionnaires.end, "At the end"),
    ):
        if items:
            yield f"{when}, {_many(len(items), 'question')}."


def _pairs(plan: Plan) -> Iterator[str]:
    """How many pairs a trial has, and when it ends earlier."""
    most = "" if plan.stop is None else "at most "
    pairs = _many(plan.queries_per_trial, "pair")
    yield f"In each trial, {most}{pairs} of videos chosen by its method."
    if plan.stop is not None:
        yield (
            f"A trial ends earlier if its model is {plan.stop.sure * 100:g} % sure that no"
            f" candidate is better by more than {plan.stop.within * 100:g} % of the range."
        )


def _shared_models(plan: Plan) -> Iterator[str]:
    """Which conditions' answers teach one model, and what it looks for."""
    for condition in plan.conditions:
        if condition.is_shared:
            best = {
                "population": "what people in general like best",
                "person": "what each person likes best, helped by the others' answers",
            }[condition.finds]
            yield (
                f"Under {condition.name}, the answers of all people teach one model, also while"
                f" they take part at the same time; pairs are chosen to find {best}. The answers of"
                " who withdraws, takes one back or is deleted no longer count from then on."
            )


def _machines(plan: Plan) -> Iterator[str]:
    """The ranges of the parameters, and how recordings are asked of machines."""
    space = plan.space
    if space is None:
        return
    ranges = []
    for parameter in plan.parameters:
        unit = f" {parameter.unit}" if parameter.unit else ""
        step = f" in steps of {parameter.step:g}" if parameter.step is not None else ""
        scale = " on a logarithmic scale" if parameter.scale == LOG else ""
        ranges.append(
            f"{parameter.name} from {parameter.min:g} to {parameter.max:g}{unit}{step}{scale}"
        )
    under = f", where {' and '.join(space.constraints)}" if space.constraints else ""
    yield f"Candidates are all points of {', '.join(ranges)}{under}."
    for name in plan.used_environments:
        yield _rollouts(name, plan.environments[name])


def _rollouts(name: str, environment: Environment) -> str:
    by = "by the simulated crane" if environment.is_crane_machine else "by a machine"
    said = environment.rollout
    again = "from its recording" if said.reuse else "from a new run"
    late = ", proposed without the last answer" if said.lag else ""
    return (
        f"In {name}, videos are recorded {by} while people choose: at most"
        f" {_many(said.new_per_query, 'new candidate')} in each pair{late}; one shown before comes"
        f" {again}. Up to {_many(said.ahead, 'rollout')} are asked for ahead; each is tried up to"
        f" {_times(said.attempts)} and may take {said.timeout_s} s."
    )


def _people(plan: Plan) -> Iterator[str]:
    if plan.places is not None:
        yield f"Places for {plan.places} people."
    if plan.reward is not None:
        yield f"{plan.reward.amount:g} {plan.reward.currency} for a completed session."
    recruitment = plan.recruitment
    if recruitment.platform != NO_PLATFORM:
        yield f"People come from {recruitment.label}."
    elif recruitment.links == "single-use":
        yield "Each person has a link of their own, which lets one in once."
    else:
        yield "Everybody who has the study's link may take part."
    if recruitment.takes_each_once:
        yield "Nobody takes part twice."
    days = plan.session_expires_after_days
    yield f"A session that was left open can be taken up for {_many(days, 'day')}."


def _order(plan: Plan) -> str:
    if plan.order == "fixed":
        return "in a fixed order"
    return "in orders balanced over people"


def _many(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _times(number: int) -> str:
    return {1: "once", 2: "twice"}.get(number, f"{number} times")
