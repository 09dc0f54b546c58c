"""How the demo's data folder keeps the way in."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.runtime.errors import SignInRequiredError
from app.services.studies import demo, repository
from tests.conftest import SHORT_PLAN, Clock, StudyShelf

URL = "http://127.0.0.1:8000"


@pytest.fixture
def stocked(
    app: AppContext, study_shelf: StudyShelf, monkeypatch: pytest.MonkeyPatch
) -> AppContext:
    """A studio that has its study already, so that none has to be made."""
    study_shelf.put_into(app, SHORT_PLAN)
    monkeypatch.setattr(demo, "STUDY", "short")
    return app


def gets_in(app: AppContext, access: demo.Access) -> bool:
    accounts.by_api_token(app, access.api_token)
    return bool(accounts.sign_in(app, access.email, access.password))


def test_a_second_start_keeps_password_and_token(stocked: AppContext) -> None:
    first = demo.prepare(stocked, URL)
    second = demo.prepare(stocked, "http://127.0.0.1:8123")
    assert (second.password, second.api_token) == (first.password, first.api_token)
    assert second.participant_url == "http://127.0.0.1:8123/s/short"
    assert gets_in(stocked, second)


@pytest.mark.parametrize("damage", ["{", "[7]", '{"password": "", "api_token": 7}'])
def test_a_damaged_file_is_made_anew_and_lets_one_in(stocked: AppContext, damage: str) -> None:
    first = demo.prepare(stocked, URL)
    path = stocked.settings.data_dir / "access.json"
    path.write_text(damage)
    second = demo.prepare(stocked, URL)
    assert json.loads(path.read_text())["password"] == second.password != first.password
    assert gets_in(stocked, second)
    with pytest.raises(SignInRequiredError):
        accounts.sign_in(stocked, first.email, first.password)


def test_a_token_that_has_run_out_is_replaced(stocked: AppContext, clock: Clock) -> None:
    first = demo.prepare(stocked, URL)
    clock.forward(accounts.API_TOKEN_LASTS.total_seconds())
    second = demo.prepare(stocked, URL)
    assert second.api_token != first.api_token
    assert gets_in(stocked, second)


def test_a_study_that_was_closed_stays_closed(stocked: AppContext) -> None:
    repository.close_study(stocked, "short")
    demo.prepare(stocked, URL)
    assert repository.find(stocked, "short").status == "closed"


def test_nothing_half_written_is_left_behind(stocked: AppContext) -> None:
    (stocked.settings.data_dir / "access.json.part").write_text("of a start that was killed")
    demo.prepare(stocked, URL)
    assert not Path(stocked.settings.data_dir / "access.json.part").exists()


def test_the_demo_opens_the_study_whose_videos_are_recorded_while_people_choose(
    stocked: AppContext,
) -> None:
    demo.prepare(stocked, URL)
    assert repository.find(stocked, "waste-crane-live").status == repository.OPEN
