"""What becomes of a study: opened, paused, closed, narrowed, revised, copied, deleted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import func, select

from app.services.accounts import accounts, audit_log
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError
from app.services.studies import access, lifecycle, repository
from app.storage.models.studies import Identity, Participant, QueryRow, Recording, SessionRow
from tests.conftest import FROM_PROLIFIC, SHORT_PLAN, Clock, write_study

from .client import Api
from .desk import Desk
from .own_study import write_own_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_study(tmp_path_factory.mktemp("kept") / "kettles", FROM_PROLIFIC)


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


@pytest.fixture
def kettles(desk: Desk, app: AppContext, folder: Path) -> str:
    """A draft of the experimenter's own: its page."""
    repository.create(app, repository.load_folder(str(folder)), desk.account.account_id)
    return "/studies/kettles"


def actions(app: AppContext, slug: str = "kettles") -> list[str]:
    return [line.action for line in reversed(audit_log.trail(app, slug))]


def test_every_step_is_taken_by_the_page_and_kept_in_the_trail(
    desk: Desk, app: AppContext, kettles: str, client: Api
) -> None:
    page = desk.get(f"{kettles}/manage").text
    assert repository.find(app, "kettles").plan_hash in page
    for step in ("open", "pause", "resume", "close", "open", "pause"):
        assert desk.post(f"{kettles}/{step}").status_code == 303, step
    assert desk.post(f"{kettles}/close").status_code == 303
    done = ["opened", "paused", "resumed", "closed", "opened", "paused", "closed"]
    assert actions(app) == ["study created", *(f"study {what}" for what in done)]
    assert {line.actor for line in audit_log.trail(app, "kettles")[:-1]} == {"mo@lab.example"}
    assert repository.find(app, "kettles").paused_at is None
    client.cookies.clear()
    assert client.post(f"{kettles}/pause", data={"csrf_token": "0"}).status_code == 303
    assert desk.post(f"{kettles}/pause").status_code == 409


def test_before_a_draft_is_opened_its_page_names_what_may_not_be_meant(
    desk: Desk, app: AppContext, kettles: str, client: Api
) -> None:
    page = desk.get(f"{kettles}/open").text
    assert "its pages have not been previewed as an evaluator" in page
    token = accounts.create_api_token(app, desk.account, "tests")
    client.start("kettles", mode="preview", by=token)
    assert "have not been previewed" not in desk.get(f"{kettles}/open").text
    assert repository.find(app, "kettles").status == "draft"
    desk.post(f"{kettles}/open")
    assert desk.get(f"{kettles}/open").headers["location"] == f"{kettles}/manage"


def test_a_paused_study_asks_newcomers_to_come_back_and_keeps_those_inside(
    desk: Desk, app: AppContext, kettles: str, client: Api, clock: Clock
) -> None:
    desk.post(f"{kettles}/open")
    inside = client.start("kettles").to_first_query()
    desk.post(f"{kettles}/pause")
    client.cookies.clear()
    page = client.get("/s/kettles")
    assert page.status_code == 409
    assert "paused just now" in page.text
    refusal = client.post("/api/v1/studies/kettles/sessions", json={})
    assert refusal.status_code == 409
    assert refusal.json()["type"] == "urn:pbpo-studio:problem:study-paused"
    assert inside.to_stage("completed", clock.forward).state["stage"] == "completed"
    desk.post(f"{kettles}/resume")
    client.cookies.clear()
    assert client.get("/s/kettles").status_code == 200


def test_a_draft_goes_at_once_and_an_open_study_does_not_go(
    desk: Desk, app: AppContext, kettles: str
) -> None:
    desk.post(f"{kettles}/open")
    assert desk.post(f"{kettles}/delete", typed="kettles").status_code == 409
    desk.post(f"{kettles}/close")
    for typed in ("", "kettle", "KETTLES"):
        answer = desk.post(f"{kettles}/delete", typed=typed)
        assert answer.status_code == 409
        assert "typed to delete it" in answer.text
    assert repository.find(app, "kettles").status == "closed"


def test_a_deleted_study_leaves_nothing_but_its_trail(
    desk: Desk, app: AppContext, kettles: str, client: Api, clock: Clock
) -> None:
    desk.post(f"{kettles}/open")
    session = client.start("kettles", external_ids={"PROLIFIC_PID": "p-1"})
    session.to_stage("completed", clock.forward)
    desk.post(f"{kettles}/close")
    videos = [path for path in app.settings.uploads_dir.iterdir() if path.suffix == ".mp4"]
    assert len(videos) == 4
    assert desk.post(f"{kettles}/delete", typed=" kettles ").status_code == 303
    with app.database.read() as database:
        for table in (Identity, Participant, SessionRow, QueryRow, Recording):
            assert database.scalar(select(func.count()).select_from(table)) == 0, table
    assert not any(path.exists() for path in videos)
    assert desk.get(kettles).status_code == 404
    last = audit_log.trail(app, "kettles")[0]
    assert (last.action, last.details["sessions"]) == ("study deleted", 1)


def test_a_video_that_another_study_shows_stays(
    desk: Desk, app: AppContext, kettles: str, tmp_path: Path
) -> None:
    other = write_own_study(tmp_path / "other")
    plan = other / "study.yaml"
    plan.write_text(plan.read_text().replace("slug: kettles", "slug: pots"))
    repository.create(app, repository.load_folder(str(other)))
    lifecycle.delete(app, "kettles")
    assert len(list(app.settings.uploads_dir.glob("*.mp4"))) == 4
    lifecycle.delete(app, "pots")
    assert list(app.settings.uploads_dir.glob("*.mp4")) == []


def test_only_its_owner_deletes_a_study(
    desk: Desk, app: AppContext, kettles: str, client: Api
) -> None:
    other = Desk(client, app, "zoe@lab.example", Role.EXPERIMENTER)
    for step in ("delete", "pause", "open", "close", "clone", "texts"):
        assert other.post(f"{kettles}/{step}", typed="kettles").status_code == 404, step
    reviewer = Desk(client, app, "rev@lab.example", Role.REVIEWER)
    for step in ("delete", "pause", "open", "close", "clone", "texts"):
        assert reviewer.post(f"{kettles}/{step}", typed="kettles").status_code == 403, step
    assert repository.find(app, "kettles").status == "draft"


def test_a_copy_is_the_same_study_under_another_slug(
    desk: Desk, app: AppContext, kettles: str
) -> None:
    answer = desk.post(f"{kettles}/clone", new_slug="pots")
    here = answer.headers["location"]
    assert "No fault found" in desk.get(here).text
    assert desk.post(f"{here}/create").status_code == 303
    first, second = repository.find(app, "kettles"), repository.find(app, "pots")
    assert second.plan == first.plan.model_copy(update={"slug": "pots"})
    assert second.texts == first.texts
    assert access.rights(app, desk.account, "pots")
    assert repository.recording_count(app, second.id) == 4
    assert "study cloned" in actions(app)
    # The draft itself, changed and created again, takes its own place.
    here = desk.post(f"{kettles}/clone").headers["location"]
    text = (app.settings.uploads_dir / here.strip("/") / "study.yaml").read_text()
    changed = text.replace("queries_per_trial: 4", "queries_per_trial: 5")
    desk.post(f"{here}/text", file="study.yaml", text=changed)
    assert desk.post(f"{here}/create").headers["location"] == kettles
    again = repository.find(app, "kettles")
    assert (again.plan.queries_per_trial, again.status) == (5, "draft")
    assert repository.recording_count(app, again.id) == 4


def test_a_copy_keeps_its_scores_and_its_candidates(
    desk: Desk, app: AppContext, kettles: str, folder: Path
) -> None:
    here = desk.post(f"{kettles}/clone", new_slug="pots").headers["location"]
    copied = repository.load_folder(str((app.settings.uploads_dir / here.strip("/")).resolve()))
    first = repository.load_folder(str(folder))
    # Of the studio's copies of the videos, which hold no metadata.
    held = [[replace(row, sha256="") for row in one.recordings] for one in (copied, first)]
    assert held[0] == held[1]


def test_a_study_of_the_crane_is_copied_too(desk: Desk, app: AppContext, tmp_path: Path) -> None:
    folder = repository.load_folder(str(write_study(tmp_path / "s", SHORT_PLAN)))
    repository.create(app, folder, desk.account.account_id)
    here = desk.post("/studies/short/clone", new_slug="shorter").headers["location"]
    assert "No fault found" in desk.get(here).text


def test_revised_texts_are_a_new_version_that_the_plan_shows(
    desk: Desk, app: AppContext, kettles: str
) -> None:
    desk.post(f"{kettles}/open")
    before = repository.find(app, "kettles")
    given = {
        f"{language}/{name}": text
        for language, named in before.texts.items()
        for name, text in named.items()
    }
    assert desk.post(f"{kettles}/texts", **given).status_code == 303
    assert repository.find(app, "kettles").plan_version == 1
    empty = desk.post(
        f"{kettles}/texts", **{**given, "en/consent": " ", "ja/debrief": "[your address]"}
    )
    assert empty.status_code == 422
    assert "texts/en/consent.md" in empty.text
    assert "texts/ja/debrief.md:1" in empty.text
    given["en/consent"] = "Another\r\nconsent.\n"
    assert desk.post(f"{kettles}/texts", **given).status_code == 303
    after = repository.find(app, "kettles")
    assert (after.plan_version, after.texts["en"]["consent"]) == (2, "Another\nconsent.\n")
    assert after.plan_hash != before.plan_hash
    assert actions(app)[-1] == "texts revised"


def test_a_page_and_a_folder_give_revised_texts_the_same_hash(
    desk: Desk, app: AppContext, kettles: str, tmp_path: Path
) -> None:
    revised = write_own_study(tmp_path / "revised", FROM_PROLIFIC)
    (revised / "texts" / "en" / "consent.md").write_text("Another consent.\n")
    whole = repository.load_folder(str(revised))
    given = {
        f"{language}/{name}": text
        for language, named in whole.texts.items()
        for name, text in named.items()
    }
    desk.post(f"{kettles}/texts", **given)
    by_page = repository.find(app, "kettles").plan_hash
    lifecycle.delete(app, "kettles")
    assert repository.create(app, whole).plan_hash == by_page


def test_sessions_go_without_the_conditions_that_are_switched_off(
    app: AppContext, client: Api, clock: Clock, short_study: repository.StudyInfo
) -> None:
    before = client.start()
    lifecycle.switch_conditions(app, "short", ["pbpo", "no-skip"])
    for _ in range(6):
        session = client.start()
        assert session.state["progress"]["trials"] == 2
        session.to_stage("completed", clock.forward)
    with app.database.read() as database:
        given = [
            tuple(row)
            for row in database.scalars(select(SessionRow.trial_conditions).order_by(SessionRow.id))
        ]
    assert all(set(row) == {0, 2} for row in given[1:])
    assert len(set(given[1:])) == 2
    # Who was in it keeps what they began with.
    assert before.look()["progress"]["trials"] == 3
    lifecycle.switch_conditions(app, "short", ["pbpo", "no-synthesis", "no-skip"])
    assert client.start().state["progress"]["trials"] == 3


def test_at_least_one_condition_stays_on(
    app: AppContext, short_study: repository.StudyInfo
) -> None:
    with pytest.raises(ConflictError, match="at least one condition"):
        lifecycle.switch_conditions(app, "short", [])
    with pytest.raises(ConflictError, match="got 'nothing'"):
        lifecycle.switch_conditions(app, "short", ["nothing"])
    assert repository.find(app, "short").conditions_off == ()


def test_blocks_stay_of_one_length(
    app: AppContext, client: Api, tmp_path: Path, clock: Clock
) -> None:
    plan = SHORT_PLAN.replace("  env1: {label: Clumps, source: crane}\n", "").replace(
        "environments:", "environments:\n  env1: {source: crane}\n  env2: {source: crane}"
    )
    plan = plan.replace(
        "trials_per_condition: 1",
        "\n".join(
            f"  - {{name: {name}, method: knockout, environment: {place}}}"
            for name, place in (("a", "env2"), ("b", "env2"), ("c", "env2"))
        )
        + "\ntrials_per_condition: 1\nblocks: environment",
    )
    repository.create(app, repository.load_folder(str(write_study(tmp_path / "s", plan))))
    repository.open_study(app, "short")
    with pytest.raises(ConflictError, match="as many conditions in each environment"):
        lifecycle.switch_conditions(app, "short", ["pbpo", "no-skip", "a"])
    lifecycle.switch_conditions(app, "short", ["pbpo", "no-skip", "a", "b"])
    session = client.start()
    assert session.state["progress"]["trials"] == 4
    stages: list[str] = []
    while session.state["stage"] != "completed":
        stages.append(session.state["stage"])
        assert session.step("left", clock.forward).status_code == 200
    assert stages.count("familiarisation") == 2
