"""Bodies, addresses and headers that are longer than anything a page sends."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from fastapi import FastAPI

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.web.http.body_limit import (
    LONGEST_ADDRESS,
    LONGEST_HEADERS,
    MOST_FIELDS,
    SMALL,
    TEXTS,
    WITH_EVENTS,
    limit_of,
)
from app.web.http.security import SIGN_IN_COOKIE
from tests.conftest import FROM_PROLIFIC

from .client import Api
from .conftest import EMAIL, PASSWORD, Recruit
from .house import routes

FORM = "application/x-www-form-urlencoded"
RESPONSES = "/api/v1/session/responses"
#: Every route that takes more than the small limit. A new one is named here on purpose.
LARGE = {
    "POST /drafts": None,
    "POST /drafts/{public_id}/files": None,
    "POST /drafts/{public_id}/text": TEXTS,
    "POST /drafts/{public_id}/settings": TEXTS,
    "POST /studies/{slug}/texts": TEXTS,
    "POST /studies/{slug}/desk/{rollout_id}/recording": None,
    "POST /api/v1/session/responses": WITH_EVENTS,
    "POST /api/v1/session/faults": WITH_EVENTS,
    "PUT /api/v1/studies/{slug}/rollouts/{rollout_id}/recording": None,
    "POST /api/v1/studies/{slug}/rollouts/{rollout_id}/measurements": WITH_EVENTS,
}
PATHS = [
    ("/api/v1/studies/short/sessions", SMALL),
    ("/api/v1/session/continue", SMALL),
    ("/s/short/consent", SMALL),
    ("/sign-in", SMALL),
    ("/studies/short/links", SMALL),
    ("/nothing/here", SMALL),
    (RESPONSES, WITH_EVENTS),
]


def kind_of(path: str) -> dict[str, str]:
    return {"Content-Type": "application/json" if "api" in path else FORM}


def test_every_route_has_a_limit_and_few_have_a_large_one(application: FastAPI) -> None:
    writing = [route for route in routes(application) if not route.startswith("GET ")]
    assert len(writing) > 40
    limits = {route: limit_of(route.partition(" ")[2]) for route in writing}
    assert {route: limit for route, limit in limits.items() if limit != SMALL} == LARGE


@pytest.mark.parametrize(("path", "limit"), PATHS)
def test_a_body_that_is_too_long_is_refused_whatever_it_says_of_itself(
    client: Api, short_study: StudyInfo, path: str, limit: int
) -> None:
    honest = client.post(path, content=b"a" * (limit + 1), headers=kind_of(path))
    assert honest.status_code in ((413, 404) if path == "/nothing/here" else (413,))
    assert "default-src 'none'" in honest.headers["content-security-policy"]
    assert len(honest.content) < 10_000

    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while sent < 10_000_000:
            sent += 10_000
            yield b"a" * 10_000

    silent = client.post(path, content=endless(), headers=kind_of(path))
    assert silent.status_code == honest.status_code
    assert sent <= limit + 20_000


def test_a_long_form_is_taken_from_somebody_who_is_signed_in_alone(
    client: Api, app: AppContext
) -> None:
    body = b"file=x&text=" + b"a" * (2 * SMALL)
    address = "/drafts/none/text"
    assert client.post(address, content=body, headers=kind_of(address)).status_code == 413
    client.cookies.set(SIGN_IN_COOKIE, "made-up")
    assert client.post(address, content=body, headers=kind_of(address)).status_code == 413

    accounts.create(app, EMAIL, PASSWORD)
    client.cookies.set(SIGN_IN_COOKIE, accounts.sign_in(app, EMAIL, PASSWORD))
    # Read, and refused for what is missing in it.
    assert client.post(address, content=body, headers=kind_of(address)).status_code == 422
    parts = {"Content-Type": "multipart/form-data; boundary=b"}
    assert client.post(address, content=body, headers=parts).status_code == 413


def test_a_form_of_separators_is_refused_before_they_are_looked_at(client: Api) -> None:
    refusal = client.post("/sign-in", content=b"&" * MOST_FIELDS, headers=kind_of("/sign-in"))
    assert refusal.status_code == 400
    assert f"at most {MOST_FIELDS:,} fields" in refusal.text


@pytest.mark.parametrize("path", ["/s/short", "/api/v1/session"])
def test_addresses_and_headers_have_limits(client: Api, path: str) -> None:
    for status, answer in (
        (414, client.get(path, params={"x": "y" * LONGEST_ADDRESS})),
        (414, client.get(f"{path}/{'x' * LONGEST_ADDRESS}")),
        (431, client.get(path, headers={"Cookie": "a=b; " * (LONGEST_HEADERS // 5)})),
    ):
        assert answer.status_code == status
        assert len(answer.content) < 1_000
        is_problem = answer.headers["content-type"] == "application/problem+json"
        assert is_problem == path.startswith("/api/")


def test_a_body_of_usual_length_is_taken(client: Api, recruit: Recruit) -> None:
    recruit(FROM_PROLIFIC)
    assert client.start(external_ids={"PROLIFIC_PID": "x" * 200}).state["stage"] == "consent"
