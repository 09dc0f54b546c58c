"""A study before it is open: looked at as an evaluator would, made again, deleted."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services import lifecycle, pilots, slugs, studies
from app.services.errors import ConflictError, NotFoundError
from app.services.studies import StudyInfo
from app.services.studio import Studio
from tests.conftest import SHORT_PLAN, write_study

from .client import Api

DRAFT_PLAN = SHORT_PLAN.replace("slug: short", "slug: draft")
#: What strangers are not told.
DRAFT_TITLE = "A short study"


@pytest.fixture
def draft(studio: Studio, tmp_path: Path) -> StudyInfo:
    return studies.create(studio, studies.load_folder(str(write_study(tmp_path / "d", DRAFT_PLAN))))


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
    studio: Studio, draft: StudyInfo, tmp_path: Path, client: Api, api_token: str
) -> None:
    client.post(
        "/api/v1/studies/draft/sessions",
        json={"mode": "preview"},
        headers={"Authorization": f"Bearer {api_token}"},
    )
    better = DRAFT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 5")
    again = studies.create(
        studio,
        studies.load_folder(str(write_study(tmp_path / "e", better))),
        proof=slugs.Proof(is_asked=True),
    )
    assert studies.find(studio, "draft").plan.queries_per_trial == 5
    assert again.id != draft.id
    assert len(studies.all_studies(studio)) == 1


def test_what_was_open_once_is_neither_replaced_nor_deleted(
    studio: Studio, draft: StudyInfo, tmp_path: Path
) -> None:
    studies.open_study(studio, "draft")
    with pytest.raises(ConflictError, match="expected a draft or a new slug"):
        studies.create(studio, studies.load_folder(str(write_study(tmp_path / "e", DRAFT_PLAN))))
    with pytest.raises(ConflictError, match="is open"):
        lifecycle.delete(studio, "draft")


def test_a_deleted_draft_is_gone(studio: Studio, draft: StudyInfo) -> None:
    lifecycle.delete(studio, "draft")
    with pytest.raises(NotFoundError):
        studies.find(studio, "draft")


@pytest.mark.parametrize("prefix", ["", "/pilot"])
@pytest.mark.parametrize("page", ["", "/consent", "/privacy", "/delete", "/deleted", "?lang=en"])
def test_a_drafts_title_is_not_shown_to_strangers(
    client: Api, draft: StudyInfo, prefix: str, page: str
) -> None:
    shown = client.get(f"{prefix}/s/{draft.slug}{page}")
    assert shown.status_code in (403, 409), shown.text
    assert DRAFT_TITLE not in shown.text


def test_a_drafts_title_is_shown_to_who_pilots_it(
    client: Api, studio: Studio, draft: StudyInfo
) -> None:
    path = pilots.path_of(draft.slug, pilots.make_link(studio, draft.slug))
    for page in (path, path.replace("?", "/privacy?")):
        assert DRAFT_TITLE in client.get(page).text
