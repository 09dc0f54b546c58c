"""The device check: the server decides by what was measured, and keeps it."""

from __future__ import annotations

from typing import Any

import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import SHORT_PLAN, StudyShelf

from .client import Api, Session
from .test_participant_pages import COOKIE, heading, sent_on

CHECKING_PLAN = SHORT_PLAN + "\ndevice_check: {min_width_px: 600, min_mbit_s: 2}\n"
GOOD = {"width_px": 1280, "played": True, "mbit_s": 12.5}


@pytest.fixture
def checking_study(app: AppContext, study_shelf: StudyShelf) -> StudyInfo:
    study_shelf.put_into(app, CHECKING_PLAN)
    return repository.find(app, "short")


def to_the_check(client: Api) -> Session:
    session = client.start()
    session.consent()
    assert session.state["stage"] == "device_check"
    return session


def test_a_device_that_passes_leads_on_and_its_measures_are_kept(
    client: Api, checking_study: StudyInfo, api_token: str
) -> None:
    session = to_the_check(client)
    shown = session.state["device_check"]
    assert (shown["min_width_px"], shown["min_mbit_s"], shown["test_clip"]) == (600, 2, True)
    assert shown["clip"]["url"].startswith("/media/")
    assert session.call("continue", {"device": GOOD}).json()["stage"] == "instructions"
    events = client.table("events", api_token)
    assert dict(zip(events["event"], events["value"], strict=True)) == {
        "device_width_px": 1280,
        "device_mbit_s": 12.5,
        "device_played": 1,
    }
    assert set(events["trial_index"]) == {-1}


@pytest.mark.parametrize(
    ("measured", "lacks"),
    [
        ({"width_px": 599}, ["width"]),
        ({"played": False}, ["clip"]),
        ({"mbit_s": 1.9}, ["line"]),
        ({"mbit_s": None}, ["line"]),
        ({"width_px": 320, "played": False, "mbit_s": 0}, ["width", "clip", "line"]),
    ],
)
def test_a_device_that_does_not_pass_is_told_why_and_may_try_again(
    client: Api, checking_study: StudyInfo, measured: dict[str, Any], lacks: list[str]
) -> None:
    session = to_the_check(client)
    refusal = session.call("continue", {"device": {**GOOD, **measured}})
    assert refusal.status_code == 409
    problem = refusal.json()
    assert problem["type"] == "urn:pbpo-studio:problem:device-refused"
    assert (problem["stage"], problem["lacks"]) == ("device_check", lacks)
    assert session.call("continue", {"device": GOOD}).json()["stage"] == "instructions"


def test_the_check_cannot_be_passed_over(client: Api, checking_study: StudyInfo) -> None:
    session = to_the_check(client)
    assert session.go_on().json()["lacks"] == ["width", "clip", "line"]
    assert session.look()["stage"] == "device_check"


def test_whoever_has_no_other_device_is_screened_out(
    client: Api, checking_study: StudyInfo, api_token: str
) -> None:
    session = to_the_check(client)
    client.cookies.set(COOKIE, session.token)
    assert heading(client.get("/s/short")) == "Is your device up to it?"
    sent_on(client.post("/s/short/screen-out"))
    assert session.look()["stage"] == "screened_out"
    assert heading(client.get("/s/short")) == "Thank you for your interest"
    assert client.table("sessions", api_token)["stage"].to_list() == ["screened_out"]
    assert session.call("continue", {"device": GOOD}).status_code == 409


def test_nobody_is_screened_out_anywhere_else(client: Api, short_study: StudyInfo) -> None:
    session = client.start()
    assert session.call("screen-out").json()["stage"] == "consent"
    assert session.consent().json()["stage"] == "instructions"
    # What a page has measured does no harm where it is not asked for.
    assert session.call("continue", {"device": GOOD}).json()["stage"] == "familiarisation"
