"""The page of a plan: in words, as a file, and every version of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.studies import repository, revision
from app.study.plan_source import read_plan
from app.study.plan_summary import in_words
from tests.conftest import SHORT_PLAN

from .client import Api
from .conftest import Recruit
from .desk import Desk
from .own_study import write_own_study


@pytest.fixture
def kettles(app: AppContext, tmp_path: Path) -> repository.StudyInfo:
    return repository.create(
        app, repository.load_folder(str(write_own_study(tmp_path / "kettles")))
    )


def test_a_plan_is_told_in_sentences() -> None:
    plan = read_plan(
        SHORT_PLAN
        + "checks: {repeats: 0.25, attention: 0}\nplaces: 12\n"
        + "recruitment: {links: single-use}\nreward: {amount: 4.5, currency: EUR}\n"
    ).plan
    assert plan is not None
    assert in_words(plan) == [
        "Before the first trial, 2 videos to watch.",
        "3 trials: each of 3 conditions once, in orders balanced over people.",
        "In each trial, 4 pairs of videos chosen by its method.",
        "Between them, as checks: 1 earlier pair again with sides swapped.",
        "120 s of rest between trials.",
        "Places for 12 people.",
        "4.5 EUR for a completed session.",
        "Each person has a link of their own, which lets one in once.",
        "A session that was left open can be taken up for 14 days.",
    ]


@pytest.mark.parametrize("role", [Role.ADMIN, Role.REVIEWER])
def test_whoever_may_see_the_design_reads_the_plan_and_takes_it_away(
    client: Api, app: AppContext, kettles: repository.StudyInfo, role: Role
) -> None:
    desk = Desk(client, app, "rev@lab.example", role)
    page = desk.get("/studies/kettles/plan").text
    assert "2 trials: each of 2 conditions once" in page
    assert "You choose between videos" in page
    assert kettles.plan_hash in page
    file = desk.get("/studies/kettles/plan/study.yaml")
    assert file.headers["content-disposition"] == 'attachment; filename="kettles-study.yaml"'
    assert kettles.plan_hash in file.text
    assert read_plan(file.text).plan == kettles.plan


def test_every_version_is_shown_with_its_hash(
    client: Api, app: AppContext, kettles: repository.StudyInfo
) -> None:
    texts = {language: dict(named) for language, named in kettles.texts.items()}
    texts["en"]["debrief"] = "Thank you all.\n"
    after = revision.revise_texts(app, "kettles", texts, "ada@lab.example")
    page = Desk(client, app, "ada@lab.example", Role.ADMIN).get("/studies/kettles/plan").text
    assert page.index(after.plan_hash) < page.index(kettles.plan_hash)
    assert "Thank you all." in page


def test_the_plan_is_nothing_for_other_experimenters(
    client: Api, app: AppContext, kettles: repository.StudyInfo
) -> None:
    other = Desk(client, app, "zoe@lab.example", Role.EXPERIMENTER)
    assert other.get("/studies/kettles/plan").status_code == 404
    assert other.get("/studies/kettles/plan/study.yaml").status_code == 404


def test_a_reviewer_reads_the_plan_without_the_codes_of_payment(
    client: Api, recruit: Recruit, app: AppContext
) -> None:
    recruit("recruitment: {platform: prolific, codes: {completed: PAIDFOR1}}\n")
    path = "/studies/short/plan/study.yaml"
    reviewer = Desk(client, app, "eve@lab.example", Role.REVIEWER)
    seen = reviewer.get(path).text
    assert "platform: prolific" in seen
    assert "PAIDFOR1" not in seen
    assert "# Without completion codes" in seen
    assert "PAIDFOR1" not in reviewer.get("/studies/short/plan").text
    assert "PAIDFOR1" in Desk(client, app, "ann@lab.example", Role.ADMIN).get(path).text
