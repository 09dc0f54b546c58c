"""The page of a study's results across sessions, and its figures."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.services.context import AppContext
from app.services.export.table import Request as Wanted
from app.services.monitoring.candidate_videos import parameters_of, recordings_of
from app.services.monitoring.overview import modes_of
from app.services.results import questionnaires
from app.services.results.candidate_words import in_words
from app.services.results.liked_best import LikedBest, liked_best
from app.services.results.registry import FINDINGS, find
from app.services.runtime.errors import NotFoundError
from app.services.studies.repository import StudyInfo
from app.web.http.security import AppDep
from app.web.http.templating import page

from .figure_files import Form, Theme, figure
from .overview_pages import mode_of
from .page_context import DataOf, SignedIn
from .study_frame import study_page

router = APIRouter(include_in_schema=False)


@router.get("/studies/{slug}/results")
def results(
    study: DataOf, request: Request, app: AppDep, caller: SignedIn, mode: str = "live"
) -> Response:
    """The page of results."""
    mode = mode_of(mode)
    figures = [
        {
            "name": name,
            "title": finding.title,
            "about": finding.about,
            "wide": finding.is_wide,
            "url": f"/studies/{study.slug}/figures/{name}",
            "query": f"?mode={mode}",
        }
        for name, finding in FINDINGS.items()
    ]
    with app.database.read() as db:
        asked = questionnaires.summaries(db, Wanted(study, modes_of(mode)))
    return study_page(
        request,
        app,
        caller,
        study,
        "results",
        mode=mode,
        questionnaires=asked,
        figures=figures,
        answer_url=f"/studies/{study.slug}/results/answer?mode={mode}",
    )


@router.get("/studies/{slug}/results/answer")
def answer(study: DataOf, request: Request, app: AppDep, mode: str = "live") -> Response:
    """The part of the page that says what is liked best: its models take a while to fit."""
    wanted = Wanted(study, modes_of(mode_of(mode)))
    groups: dict[str, list[dict[str, Any]]] = {}
    for found in liked_best(app, wanted):
        groups.setdefault(found.environment, []).append(_shown(app, study, found))
    environments = [
        {
            "name": name,
            "label": study.plan.text(named.label, study.plan.default_language)
            if (named := study.plan.environments[name]).label
            else name,
            "answers": answers,
        }
        for name, answers in groups.items()
    ]
    said = {"environments": environments, "has_ranges": study.plan.has_ranges}
    return page(request, "experimenter/_answer.html", said)


def _shown(app: AppContext, study: StudyInfo, found: LikedBest) -> dict[str, Any]:
    """What the template shows of one answer: words and videos of the two candidates."""
    space = app.proposer.candidate_set(study.id, found.environment)

    def candidate(index: int) -> dict[str, Any]:
        return {
            "words": in_words(parameters_of(space, index), study.plan),
            "videos": recordings_of(app, space, index),
        }

    return {
        "found": found,
        "best": candidate(found.best),
        "runner_up": None if found.runner_up is None else candidate(found.runner_up),
    }


@router.get("/studies/{slug}/figures/{name}.{form}")
def results_figure(
    study: DataOf,
    app: AppDep,
    name: str,
    form: Form,
    mode: str = "live",
    theme: Theme = "light",
) -> Response:
    """One figure of the results page."""
    if name not in FINDINGS:
        raise NotFoundError(f"expected one of {', '.join(FINDINGS)}, got {name!r}")
    mode = mode_of(mode)
    found = find(app, Wanted(study, modes_of(mode)), name)
    marked = "" if mode == "live" else f"-{mode}"
    return figure(name, found, study, form, theme, f"{study.slug}-{name}{marked}")
