"""STATE: the stage of a session and what that stage shows, as its browser may see it.

It contains no parameter, score, method or condition, and the addresses of recordings are opaque.
"""

from __future__ import annotations

import math
from datetime import datetime
from functools import lru_cache
from typing import Any

from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.recordings.addresses import DEVICE_CHECK, FAMILIARISATION
from app.services.studies.repository import plan_of, stored_plan, stored_texts
from app.services.studies.session_modes import LIVE
from app.storage.models.studies import SessionRow
from app.study import markdown as study_markdown
from app.study.plan import Plan
from app.study.query_settings import WORDS as QUERY_WORDS
from app.study.questionnaire import Item
from app.study.stages import AFTER_TRIAL, AT_THE_END, FINAL_STAGES, Progress, Stage, position
from app.study.time_left import seconds_left

from . import box_view, completion, consents, familiarisation, query_view
from .queries import OpenQuery

State = dict[str, Any]

#: The final stages.
ENDED = tuple(stage.value for stage in FINAL_STAGES)


def describe(
    app: AppContext, db: Session, session: SessionRow, trial: OpenQuery | None = None
) -> State:
    """The STATE of a session, as the API defines it.

    trial: the open query, if the caller has it at hand; otherwise it is read.
    """
    plan = stored_plan(session.plan)
    progress = read_progress(session)
    state: State = {
        "stage": progress.stage.value,
        "progress": position(plan_of(session), progress),
        "study": study_of(plan, session.study.slug, session.language),
        "language": session.language,
    }
    written = stored_texts(session.plan)[session.language]
    changed = consents.due(db, session)
    if changed is not None:
        # The consent has changed: nothing else is shown until the person agrees to it.
        state["stage"] = Stage.CONSENT.value
        state["consent"] = consents.text(stored_texts(changed)[session.language])
        if progress.stage is not Stage.CONSENT:
            state["consent"]["again"] = True
        return state
    match progress.stage:
        case Stage.CONSENT:
            state["consent"] = consents.text(written)
        case Stage.DEVICE_CHECK:
            state["device_check"] = _device_check(app, session, plan)
        case Stage.INSTRUCTIONS:
            state["instructions"] = {"html": rendered(written["instructions"])}
        case Stage.FAMILIARISATION:
            state["familiarisation"] = {
                "videos": [
                    query_view.video(app, session, clip, (FAMILIARISATION, place))
                    for place, clip in enumerate(
                        familiarisation.videos(app, session), familiarisation.first_index(session)
                    )
                ],
                "required": plan.familiarisation.required,
                "watched": familiarisation.watched(session),
                "speeds": list(plan.familiarisation.speeds),
            }
        case Stage.PRACTICE | Stage.QUERY:
            state |= _open_query(app, db, session, trial)
        case Stage.QUESTIONNAIRE:
            state["questionnaire"] = _questionnaire(plan, progress.query_index, session.language)
        case Stage.BREAK:
            assert progress.break_ends_at is not None
            state["break"] = {
                **_break(plan, progress.break_ends_at, app.now()),
                "next_skip": _skip(plan, session, progress.trial_index),
            }
        case Stage.DEBRIEF:
            state["debrief"] = {"html": rendered(written["debrief"])}
        case Stage.COMPLETED | Stage.SCREENED_OUT | Stage.WITHDRAWN | Stage.DECLINED:
            # A completion code is worth money, so only live sessions get one.
            way_back = completion.at_the_end(db, session, plan) if session.mode == LIVE else None
            if way_back is not None:
                state[progress.stage.value] = way_back
    return state


def _open_query(
    app: AppContext, db: Session, session: SessionRow, trial: OpenQuery | None
) -> State:
    """The `query` of STATE, and `waiting` while its videos are not recorded yet."""
    if stored_plan(session.plan).has_ranges:
        return box_view.describe(app, db, session, trial)
    return {"query": query_view.describe(app, db, session, trial)}


def study_of(plan: Plan, slug: str, language: str) -> dict[str, Any]:
    """The `study` of STATE: what every page may show. `stages` are those of the plan, in order."""
    asks = plan.items(AFTER_TRIAL) or plan.items(AT_THE_END)
    optional = {
        Stage.DEVICE_CHECK: plan.device_check is not None,
        Stage.FAMILIARISATION: plan.familiarisation.videos > 0,
        Stage.PRACTICE: plan.practice.queries > 0,
        Stage.QUESTIONNAIRE: bool(asks),
        Stage.BREAK: plan.break_s > 0,
    }
    state: dict[str, Any] = {
        "slug": slug,
        "title": plan.text(plan.title, language),
        "contact": plan.contact,
        "break_s": plan.break_s,
        "stages": [
            stage.value
            for stage in Stage
            if stage not in FINAL_STAGES and optional.get(stage, True)
        ],
    }
    given = {name: getattr(plan.query, name) for name in QUERY_WORDS}
    words = {name: plan.text(text, language) for name, text in given.items() if text is not None}
    return state | ({"words": words} if words else {})


def read_progress(session: SessionRow) -> Progress:
    """The session's progress as the protocol's value."""
    return Progress(
        Stage(session.stage), session.trial_index, session.query_index, session.break_ends_at
    )


def store_progress(session: SessionRow, progress: Progress) -> None:
    """Write the protocol's progress into the session's row."""
    session.stage = progress.stage.value
    session.trial_index = progress.trial_index
    session.query_index = progress.query_index
    session.break_ends_at = progress.break_ends_at


@lru_cache(maxsize=256)
def rendered(markdown: str) -> str:
    """The HTML of a Markdown text, cached."""
    return study_markdown.render(markdown)


def _device_check(app: AppContext, session: SessionRow, plan: Plan) -> dict[str, Any]:
    check = plan.device_check
    assert check is not None
    return {
        "clip": query_view.video(
            app, session, familiarisation.device_check_videos(app, session)[0], (DEVICE_CHECK, 0)
        ),
        "test_clip": check.test_clip,
        "min_width_px": check.min_width_px,
        "min_mbit_s": check.min_mbit_s,
    }


def _questionnaire(plan: Plan, page: int, language: str) -> dict[str, Any]:
    return {
        "page": "trial" if page == AFTER_TRIAL else "end",
        "items": [
            {
                "name": item.name,
                "type": item.type,
                "label": plan.text(item.label, language),
                "required": item.required,
                "points": item.scale if item.type == "likert" else None,
                "labels": [plan.text(label, language) for label in item.labels or ()],
                "min": item.min,
                "max": item.max,
                **_choices(plan, item, language),
            }
            for item in plan.items(page)
        ],
    }


def _choices(plan: Plan, item: Item, language: str) -> dict[str, Any]:
    """The `choices` of an item to choose from; no key for others."""
    if item.choices is None:
        return {}
    texts = item.choices.items()
    return {"choices": [{"name": name, "label": plan.text(text, language)} for name, text in texts]}


def _skip(plan: Plan, session: SessionRow, trial_index: int) -> dict[str, str] | None:
    """The skip button's label in a trial; None if the trial offers no skip."""
    skip = plan.conditions[session.trial_conditions[trial_index]].skip
    return None if skip is None else {"label": plan.text(skip.label, session.language)}


def _break(plan: Plan, ends_at: datetime, now: datetime) -> dict[str, Any]:
    left = math.ceil(seconds_left(plan.break_s, ends_at, now))
    return {"ends_at": ends_at.isoformat().replace("+00:00", "Z"), "seconds_left": left}
