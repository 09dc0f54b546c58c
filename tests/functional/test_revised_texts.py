"""New texts for a study under way: whoever agreed to another consent is asked again."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.studies import repository, revision
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, Clock, write_study

from .client import Api, Session
from .own_study import write_own_study
from .test_participant_pages import COOKIE, heading, sent_on, version

NEW = "You choose between videos. Your answers are kept for ten years.\n"


def revise(
    app: AppContext,
    folder: Path,
    *,
    consent: str = NEW,
    debrief: str | None = None,
    plan: str = SHORT_PLAN,
) -> StudyInfo:
    """Give the short study a changed consent (and debrief)."""
    write_study(folder, plan)
    (folder / "texts" / "en" / "consent.md").write_text(consent)
    if debrief is not None:
        (folder / "texts" / "en" / "debrief.md").write_text(debrief)
    return revision.revise(app, repository.load_folder(str(folder)))


@pytest.mark.parametrize("stage", ["instructions", "familiarisation", "query", "break", "debrief"])
def test_a_changed_consent_is_asked_for_again_and_the_session_keeps_its_place(
    client: Api,
    app: AppContext,
    short_study: StudyInfo,
    clock: Clock,
    tmp_path: Path,
    stage: str,
    api_token: str,
) -> None:
    session = client.start().to_stage(stage, clock.forward)
    before = session.look()
    old = client.table("sessions", api_token)["consent_version"].item()
    assert revise(app, tmp_path / "new").plan_version == 2

    asked = session.look()
    assert asked["stage"] == "consent"
    assert "ten years" in asked["consent"]["html"]
    assert (asked["consent"]["again"], asked["progress"]) == (True, before["progress"])
    refusal = session.go_on()
    assert (refusal.status_code, refusal.json()["stage"]) == (409, "consent")
    assert session.call("consent", {"version": old}).json()["current_version"] != old

    assert session.consent().status_code == 200
    assert session.state == before
    row = client.table("sessions", api_token).iloc[0]
    assert row["consent_version"] == asked["consent"]["version"]
    agreed = client.table("consents", api_token)
    assert agreed["consent_version"].to_list() == [old, row["consent_version"]]
    assert agreed["plan_version"].to_list() == [1, 2]


def test_an_answer_given_before_the_text_changed_is_kept_and_the_consent_comes_next(
    client: Api, app: AppContext, short_study: StudyInfo, tmp_path: Path, api_token: str
) -> None:
    session = client.start().to_first_query()
    revise(app, tmp_path / "new")
    assert session.respond("left").json()["stage"] == "consent"
    session.consent()
    assert (session.state["stage"], session.state["progress"]["query"]) == ("query", 2)
    session.respond("right")
    answered = client.table("queries", api_token)["response"].dropna().to_list()
    assert answered == ["left", "right"]


def test_who_does_not_agree_again_stops_and_what_they_gave_is_kept(
    client: Api, app: AppContext, short_study: StudyInfo, tmp_path: Path, api_token: str
) -> None:
    session = client.start().to_first_query()
    session.respond("left")
    revise(app, tmp_path / "new")
    client.cookies.set(COOKIE, session.token)
    page = client.get("/s/short")
    assert heading(page) == "Before you take part"
    assert "has changed since you agreed" in page.text
    sent_on(client.post("/s/short/decline"))
    assert session.look()["stage"] == "withdrawn"
    assert client.table("queries", api_token)["response"].dropna().to_list() == ["left"]


def test_agreeing_again_on_the_page_leads_back_to_where_one_was(
    client: Api, app: AppContext, short_study: StudyInfo, tmp_path: Path
) -> None:
    session = client.start().to_first_query()
    revise(app, tmp_path / "new")
    client.cookies.set(COOKIE, session.token)
    page = client.get("/s/short")
    sent_on(client.post("/s/short/consent", data={"version": version(page)}))
    assert heading(client.get("/s/short")) == "Which video is better?"


def test_another_text_than_the_consent_asks_nobody_again(
    client: Api, app: AppContext, short_study: StudyInfo, tmp_path: Path
) -> None:
    session = client.start().to_first_query()
    old = short_study.texts["en"]["consent"]
    assert revise(app, tmp_path / "new", consent=old, debrief="New.\n").plan_version == 2
    assert session.look()["stage"] == "query"


def test_whoever_has_not_agreed_yet_is_asked_for_the_newest_text(
    client: Api, app: AppContext, short_study: StudyInfo, tmp_path: Path
) -> None:
    session = client.start()
    revise(app, tmp_path / "new")
    assert "ten years" in session.look()["consent"]["html"]
    assert "again" not in session.state["consent"]
    assert session.consent().json()["stage"] == "instructions"


def test_a_session_that_has_ended_is_left_alone(
    client: Api, app: AppContext, short_study: StudyInfo, clock: Clock, tmp_path: Path
) -> None:
    db: Session = client.start().to_stage("completed", clock.forward)
    revise(app, tmp_path / "new")
    assert db.look()["stage"] == "completed"


def test_the_same_texts_again_make_no_version(
    app: AppContext, short_study: StudyInfo, tmp_path: Path
) -> None:
    first = revise(app, tmp_path / "one")
    assert revise(app, tmp_path / "two") == first


def test_what_is_compared_cannot_be_revised(
    app: AppContext, short_study: StudyInfo, tmp_path: Path
) -> None:
    other = SHORT_PLAN.replace("queries_per_trial: 4", "queries_per_trial: 5")
    with pytest.raises(ConflictError, match="expected the plan that 'short' has"):
        revise(app, tmp_path / "new", plan=other)


def test_recordings_cannot_be_revised(app: AppContext, tmp_path: Path) -> None:
    folder = write_own_study(tmp_path / "own")
    repository.create(app, repository.load_folder(str(folder)))
    (folder / "texts" / "en" / "consent.md").write_text(NEW)
    assert revision.revise(app, repository.load_folder(str(folder))).plan_version == 2
    table = folder / "recordings.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(ConflictError, match="expected the recordings that 'kettles' has"):
        revision.revise(app, repository.load_folder(str(folder)))
