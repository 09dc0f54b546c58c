"""The page of people judged together, a condition at a time, and its figures."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.export.table import Request as Wanted
from app.services.export.table import trials_of
from app.services.monitoring.overview import modes_of
from app.services.pooling.people import PooledPeople, judged_together
from app.services.results import people, people_words
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import StudyInfo
from app.web.http.security import AppDep

from .figure_files import Form, Theme, figure
from .overview_pages import mode_of
from .page_context import DataOf, SignedIn
from .study_frame import study_page

router = APIRouter(prefix="/studies/{slug}/results/people", include_in_schema=False)


@router.get("")
def people_results(
    study: DataOf,
    request: Request,
    app: AppDep,
    caller: SignedIn,
    mode: str = "live",
    condition: str = "",
) -> Response:
    """The page; while many answers are being judged it says so, and asks again."""
    mode, condition = mode_of(mode), _condition(study, condition)
    found = _judged(app, study, condition, mode)
    summary, plan = found.summary, study.plan
    address = f"/studies/{study.slug}/results/people"
    query = f"?{urlencode({'mode': mode, 'condition': condition})}"
    figures = [
        {
            "name": name,
            "title": one.title,
            "about": one.about,
            "wide": one.is_wide,
            "url": f"{address}/{name}",
            "query": query,
        }
        for name, one in people.PEOPLE_FINDINGS.items()
    ]
    return study_page(
        request,
        app,
        caller,
        study,
        "people_results",
        tab="results",
        mode=mode,
        condition=condition,
        conditions=[
            {"name": one.name, "url": f"?{urlencode({'mode': mode, 'condition': one.name})}"}
            for one in plan.conditions
        ],
        found=found,
        answers=len(found.pooled.request.history),
        number=found.pooled.people,
        sentences=people.sentences(found, summary, plan) if summary else (),
        table=people.table_of_people(found, summary, plan) if summary else None,
        flagged=[person for person in found.people if person.reasons],
        notes=people_words.NOTES,
        figures=figures if summary else [],
    )


@router.get("/{name}.{form}")
def people_figure(
    study: DataOf,
    app: AppDep,
    name: str,
    form: Form,
    mode: str = "live",
    condition: str = "",
    theme: Theme = "light",
) -> Response:
    """One figure of the page."""
    if name not in people.PEOPLE_FINDINGS:
        raise NotFoundError(f"expected one of {', '.join(people.PEOPLE_FINDINGS)}, got {name!r}")
    mode, condition = mode_of(mode), _condition(study, condition)
    found = people.read(name, _judged(app, study, condition, mode), study.plan)
    marked = "" if mode == "live" else f"-{mode}"
    named = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in condition)
    file = f"{study.slug}-people-{named}-{name}{marked}"
    return figure(name, found, study, form, theme, file, of_people=True)


def _condition(study: StudyInfo, asked: str) -> str:
    """The condition that was asked for, by default the first."""
    names = [one.name for one in study.plan.conditions]
    if not asked:
        return names[0]
    if asked not in names:
        raise NotFoundError(f"expected a condition among {', '.join(names)}, got {asked!r}")
    return asked


def _judged(app: AppContext, study: StudyInfo, condition: str, mode: str) -> PooledPeople:
    modes = modes_of(mode)
    with app.database.read() as db:
        return judged_together(
            db,
            app.proposer.people,
            study,
            condition,
            modes,
            *trials_of(Wanted(study, modes)),
            waits=False,
        )
