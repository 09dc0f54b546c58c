"""Two studies that come to one slug: the second replaces the first only if it is the same study."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.errors import SlugTakenError
from app.services.studies import repository, sharing
from app.services.studies.slugs import Proof
from app.study.draft_plan import slug_of
from tests.conftest import SHORT_PLAN, write_study

from .client import Api
from .desk import Desk, zipped
from .test_commands import Run, mistake, pbpo

__all__ = ["pbpo"]

OTHER = SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 5")


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


def made(desk: Desk, folder: Path) -> str:
    """A study made of this folder in the browser: the address of what was answered."""
    here = desk.begin({"study.zip": zipped(folder)})
    answer = desk.post(f"{here}/create")
    assert answer.status_code == 303, answer.text
    return here


def test_another_folder_of_the_same_slug_replaces_nothing(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    first = repository.find(app, "short")
    here = desk.begin({"b.zip": zipped(write_study(tmp_path / "b", OTHER))})
    page = desk.get(here).text
    assert "No fault found" not in page
    assert "&#39;short-2&#39; is free" in page
    answer = desk.post(f"{here}/create")
    assert (answer.status_code, "another slug" in answer.text) == (422, True)
    assert repository.find(app, "short") == first
    # The slug is changed in the settings, and both are there.
    assert desk.post(f"{here}/settings", **fields(desk, here, slug="short-2")).status_code == 303
    assert "No fault found" in desk.get(here).text
    assert desk.post(f"{here}/create").status_code == 303
    assert {info.slug for info in repository.all_studies(app)} == {"short", "short-2"}


def fields(desk: Desk, here: str, **changed: str) -> dict[str, str]:
    page = desk.get(f"{here}/settings").text
    found = dict(re.findall(r'<input[^>]*name="([^"]+)"[^>]*value="([^"]*)"', page))
    assert "slug" in found
    chosen = re.findall(r'<select name="([^"]+)">(.*?)</select>', page, re.DOTALL)
    for name, options in chosen:
        selected = re.search(r'<option(?: value="([^"]*)")? selected>([^<]*)', options)
        if selected:
            found[name] = selected[1] or selected[2]
    found.pop("csrf_token")
    return {**found, **changed}


def test_a_draft_is_changed_by_its_own_copy(desk: Desk, app: AppContext, tmp_path: Path) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    first = repository.find(app, "short")
    here = desk.post("/studies/short/clone").headers["location"]
    assert ".origin" not in desk.get(here).text
    text = desk.get(f"{here}/text?file=study.yaml").text
    assert "queries_per_trial: 4" in text
    saved = desk.post(f"{here}/text", file="study.yaml", text=OTHER)
    assert saved.status_code == 303
    assert "takes the place of the draft" in desk.get(here).text
    assert desk.post(f"{here}/create").status_code == 303
    now = repository.find(app, "short")
    assert (now.plan.queries_per_trial, now.id != first.id) == (5, True)


def test_a_copy_of_a_draft_that_was_replaced_meanwhile_replaces_no_newer_one(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    first, second = (desk.post("/studies/short/clone").headers["location"] for _ in range(2))
    for here, number in ((first, 5), (second, 6)):
        text = SHORT_PLAN.replace("queries_per_trial: 4", f"queries_per_trial: {number}")
        desk.post(f"{here}/text", file="study.yaml", text=text)
    assert desk.post(f"{first}/create").status_code == 303
    assert desk.post(f"{second}/create").status_code == 422
    assert repository.find(app, "short").plan.queries_per_trial == 5


def test_the_very_same_study_again_changes_nothing(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    folder = write_study(tmp_path / "a", SHORT_PLAN)
    made(desk, folder)
    first = repository.find(app, "short")
    made(desk, folder)
    assert repository.find(app, "short").id == first.id


def test_a_copy_knows_which_slugs_are_taken(desk: Desk, tmp_path: Path) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    made(desk, write_study(tmp_path / "r", SHORT_PLAN.replace("slug: short", "slug: rich")))
    answer = desk.post("/studies/short/clone", new_slug="rich")
    assert (answer.status_code, "is taken" in answer.text) == (409, True)
    assert desk.post("/studies/short/clone", new_slug="richer").status_code == 303


def test_an_open_study_is_copied_under_another_slug_only(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    repository.open_study(app, "short")
    assert desk.post("/studies/short/clone").status_code == 409


def test_titles_that_come_to_one_slug_get_one_each(desk: Desk) -> None:
    slugs = []
    for title in (
        "注ぐ水",
        "水を注ぐ",
        "Pouring",
        "Pouring",
        "Pouring!",
        "new",
        "実験 1",
        "調査 1",
    ):
        here = desk.begin({}, name=title)
        page = desk.get(f"{here}/settings").text
        found = re.search(r'name="slug"[^>]* value="([^"]*)"', page)
        assert found is not None
        slugs.append(found[1])
    assert len(set(slugs)) == len(slugs)
    assert slugs[2:6] == ["pouring", "pouring-2", "pouring-3", "new-2"]
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9-]{0,59}", slug) for slug in slugs)


@pytest.mark.parametrize(
    ("title", "slug"),
    [
        ("Pouring water!", "pouring-water"),
        ("Gießen üben", "giessen-uben"),
        ("", "my-study"),
        ("!!!", "my-study"),
        ("x" * 100, "x" * 60),
    ],
)
def test_a_slug_is_made_of_the_letters_of_a_title(title: str, slug: str) -> None:
    assert slug_of(title) == slug


def test_the_command_line_replaces_its_own_folders_draft_alone(pbpo: Run, tmp_path: Path) -> None:
    first = write_study(tmp_path / "a", SHORT_PLAN)
    assert pbpo("study", "create", first).status == 0
    (first / "study.yaml").write_text(OTHER, encoding="utf-8")
    assert pbpo("study", "create", first).status == 0
    second = write_study(tmp_path / "b", SHORT_PLAN)
    assert "taken by a draft" in pbpo("study", "check", second).out
    assert "taken" not in pbpo("study", "check", first).out
    said = mistake(pbpo("study", "create", second))
    assert "'short' already" in said
    assert "--replace" in said
    assert pbpo("study", "create", second, "--replace").status == 0


def test_the_command_line_replaces_no_draft_of_an_account(
    desk: Desk, app: AppContext, tmp_path: Path
) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    tie = sharing.members(app, "short")[0]
    assert tie.is_owner
    other = repository.load_folder(str(write_study(tmp_path / "b", OTHER)))
    with pytest.raises(SlugTakenError):
        repository.create(app, other)
    with pytest.raises(SlugTakenError):
        repository.create(app, other, proof=Proof(origin=10**9))


def test_the_command_line_leaves_a_draft_of_an_account_even_if_asked(
    pbpo: Run, desk: Desk, tmp_path: Path
) -> None:
    made(desk, write_study(tmp_path / "a", SHORT_PLAN))
    other = write_study(tmp_path / "b", OTHER)
    said = mistake(pbpo("study", "create", other, "--replace"))
    assert "its owner alone" in said
