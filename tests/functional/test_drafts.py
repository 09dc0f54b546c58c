"""A study before it is open: looked at as an evaluator would, made again, deleted."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services.arrival import pilot_links
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError
from app.services.studies import lifecycle, repository, slugs
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, write_study

from .client import Api

DRAFT_PLAN = SHORT_PLAN.replace("slug: short", "slug: draft")
#: What strangers are not told.
DRAFT_TITLE = "A short study"


@pytest.fixture
def draft(app: AppContext, tmp_path: Path) -> StudyInfo:
    return repository.create(
        app, repository.load_folder(str(write_study(tmp_path / "d", DRAFT_PLAN)))
    )


def test_an_experimenter_goes_through_a_draft_and_its_data_stays_out_of_results(
    client: Api, draft: StudyInfo, api_token: str
) -> None:
    headers = {"Authorization": f"Bearer {api_token}"}
    path = f"/api/v1/studies/{draft.slug}/sessions"
    assert client.post(path, json={"mode": "preview"}).status_code == 403
    assert client.post(path, json={"mode": "preview"}, headers=headers).status_code == 201

    export = f"/api/v1/studies/{draft.slug}/export/sessions.csv"
    assert len(client.get(export, headers=headers).text.splitlines()) == 1
    shown = client.get(export, headers=headers, params={"mode": "preview"}).text.splitlines()
    assert len(shown) == 2


def test_a_draft_made_again_takes_the_place_of_the_first(
    app: AppContext, draft: StudyInfo, tmp_path: Path, client: Api, api_token: str
) -> None:
    client.post(
        "/api/v1/studies/draft/sessions",
        json={"mode": "preview"},
        headers={"Authorization": f"Bearer {api_token}"},
    )
    better = DRAFT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 5")
    again = repository.create(
        app,
        repository.load_folder(str(write_study(tmp_path / "e", better))),
        proof=slugs.Proof(is_asked=True),
    )
    assert repository.find(app, "draft").plan.queries_per_trial == 5
    assert again.id != draft.id
    assert len(repository.all_studies(app)) == 1


def test_what_was_open_once_is_neither_replaced_nor_deleted(
    app: AppContext, draft: StudyInfo, tmp_path: Path
) -> None:
    repository.open_study(app, "draft")
    with pytest.raises(ConflictError, match="expected a draft or a new slug"):
        repository.create(app, repository.load_folder(str(write_study(tmp_path / "e", DRAFT_PLAN))))
    with pytest.raises(ConflictError, match="is open"):
        lifecycle.delete(app, "draft")


def test_a_deleted_draft_is_gone(app: AppContext, draft: StudyInfo) -> None:
    lifecycle.delete(app, "draft")
    with pytest.raises(NotFoundError):
        repository.find(app, "draft")


@pytest.mark.parametrize("prefix", ["", "/pilot"])
@pytest.mark.parametrize("page", ["", "/consent", "/privacy", "/delete", "/deleted", "?lang=en"])
def test_a_drafts_title_is_not_shown_to_strangers(
    client: Api, draft: StudyInfo, prefix: str, page: str
) -> None:
    shown = client.get(f"{prefix}/s/{draft.slug}{page}")
    assert shown.status_code in (403, 409), shown.text
    assert DRAFT_TITLE not in shown.text


def test_a_drafts_title_is_shown_to_who_pilots_it(
    client: Api, app: AppContext, draft: StudyInfo
) -> None:
    path = pilot_links.path_of(draft.slug, pilot_links.make_link(app, draft.slug))
    for page in (path, path.replace("?", "/privacy?")):
        assert DRAFT_TITLE in client.get(page).text
