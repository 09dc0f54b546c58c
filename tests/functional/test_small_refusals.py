"""Refusals are small and quick, whatever was sent."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest

from app.services.studies.repository import StudyInfo
from app.study.shortening import shortened

from .client import Api
from .test_experimenter_pages import sign_in

MOST = 10_000
#: How long one refusal may keep the event loop, as a part of a second: ten times what is measured.
QUICK_S = 0.3

SESSIONS = "/api/v1/studies/short/sessions"
RESPONSES, FAULTS = "/api/v1/session/responses", "/api/v1/session/faults"
QUESTIONNAIRE, DEVICE = "/api/v1/session/questionnaire", "/api/v1/session/continue"


def keys(number: int, name: str = "k") -> dict[str, int]:
    return {f"{name}{index}": 0 for index in range(number)}


#: Each within the limit of its route but for the first.
BODIES: dict[str, tuple[str, str]] = {
    "780,000 keys": (SESSIONS, json.dumps(keys(780_000))),
    "5,000 keys": (SESSIONS, json.dumps(keys(5_000))),
    "long keys": (SESSIONS, json.dumps(keys(20, "k" * 3_000))),
    "keys of control characters": (SESSIONS, json.dumps(keys(20, "\x01" * 400))),
    "keys of kanji": (SESSIONS, json.dumps(keys(20, "日" * 900), ensure_ascii=False)),
    "one long key": (SESSIONS, json.dumps(keys(1, "k" * 60_000))),
    "half a surrogate pair": (SESSIONS, '{"\\ud800": 1}'),
    "5,000 ids": (SESSIONS, json.dumps({"external_ids": keys(5_000)})),
    "long ids": (SESSIONS, json.dumps({"external_ids": keys(15, "k" * 4_000)})),
    "levels": (SESSIONS, "[" * 60_000),
    "a long number": (SESSIONS, f'{{"mode": {"9" * 60_000}}}'),
    "a number of 4,000 digits": (SESSIONS, f'{{"mode": {"9" * 4_000}}}'),
    "a long mode": (SESSIONS, json.dumps({"mode": "x" * 60_000})),
    "5,000 answers": (QUESTIONNAIRE, json.dumps({"answers": keys(5_000)})),
    "90 answers": (QUESTIONNAIRE, json.dumps({"answers": {key: [] for key in keys(90)}})),
    "keys of a device": (DEVICE, json.dumps({"device": keys(5_000)})),
    "keys of a response": (RESPONSES, json.dumps(keys(45_000))),
    "empty events": (RESPONSES, json.dumps({"events": [{}] * 140_000})),
    "lists for events": (FAULTS, json.dumps({"events": [[]] * 140_000})),
    "keys of an event": (FAULTS, json.dumps({"events": [keys(45_000)]})),
    "keys of events": (FAULTS, json.dumps({"events": [keys(20)] * 2_000})),
    "levels of a response": (RESPONSES, "[" * 590_000),
    "a long query": (RESPONSES, json.dumps({"query_id": "x" * 500_000, "response": "left"})),
}


def post(client: Api, path: str, body: str, **headers: str) -> Any:
    given = {"Content-Type": "application/json", "Authorization": "Bearer none", **headers}
    return client.post(path, content=body.encode(), headers=given)


@pytest.mark.parametrize("name", BODIES)
def test_a_refusal_is_small_and_quick(client: Api, short_study: StudyInfo, name: str) -> None:
    path, body = BODIES[name]
    post(client, path, "{}")
    begun = time.process_time()
    answer = post(client, path, body)
    assert time.process_time() - begun < QUICK_S
    assert answer.status_code in (400, 413, 422), answer.text[:500]
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) < MOST
    assert len(answer.json().get("errors", ())) <= 20


def test_faults_beyond_the_first_are_counted(client: Api, short_study: StudyInfo) -> None:
    answer = post(client, SESSIONS, json.dumps(keys(23))).json()
    assert len(answer["errors"]) == 20
    assert answer["detail"].startswith("body/k0: ")
    assert answer["detail"].endswith("; and 3 more")

    many = post(client, SESSIONS, json.dumps(keys(5_000))).json()
    assert many["detail"] == "body: Expected at most 24 entries, got 5,000"


def test_a_long_name_is_shortened(client: Api, short_study: StudyInfo) -> None:
    answer = post(client, SESSIONS, json.dumps(keys(1, "n" * 50_000))).json()
    (fault,) = answer["errors"]
    assert fault["pointer"].startswith("body/nnn")
    assert fault["pointer"].endswith("… (50,006 characters)")


def test_pages_and_addresses_repeat_no_more(
    client: Api, short_study: StudyInfo, api_token: str
) -> None:
    long = "x<&" * 2_000
    sign_in(client)
    for answer in (
        client.get(f"/s/{long}"),
        client.get(f"/nothing/{long}"),
        client.get(f"/api/v1/studies/{long}/export/queries.csv"),
        client.get("/studies/short/results", params={"mode": long}),
        client.get(f"/studies/short/sessions/{long}"),
        client.post("/sign-in", data={"email": long * 5, "password": long * 3}),
        client.post("/studies/short/share", data={"email": long, "csrf_token": long}),
    ):
        assert len(answer.content) < MOST or answer.status_code == 200, answer.url


def test_a_text_keeps_its_beginning_and_says_its_length() -> None:
    assert shortened("short") == "short"
    assert shortened("a" * 2_000, 10) == "aaaaaaaaaa… (2,000 characters)"
    assert len(json.dumps(shortened("\x01" * 2_000, 100), ensure_ascii=False)) < 130
