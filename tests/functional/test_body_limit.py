"""Bodies that are longer than anybody means."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from app.services.studies import StudyInfo
from app.web.body_limit import LONGEST_BODY
from tests.conftest import FROM_PROLIFIC

from .client import Api
from .conftest import Recruit

PATHS = ["/api/v1/studies/short/sessions", "/s/short/consent", "/sign-in"]
FORM = "application/x-www-form-urlencoded"


@pytest.mark.parametrize("path", PATHS)
def test_a_body_that_is_too_long_is_refused_whatever_it_says_of_itself(
    client: Api, short_study: StudyInfo, path: str
) -> None:
    kinds = {"Content-Type": "application/json" if "api" in path else FORM}
    honest = client.post(path, content=b"a" * (LONGEST_BODY + 1), headers=kinds)
    assert honest.status_code == 413
    assert "default-src 'none'" in honest.headers["content-security-policy"]

    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while sent < 10 * LONGEST_BODY:
            sent += 100_000
            yield b"a" * 100_000

    silent = client.post(path, content=endless(), headers=kinds)
    # One field of a form has a shorter limit of its own.
    assert silent.status_code in (400, 413)
    assert sent <= 1.1 * LONGEST_BODY


def test_a_body_of_usual_length_is_taken(client: Api, recruit: Recruit) -> None:
    recruit(FROM_PROLIFIC)
    assert client.start(external_ids={"PROLIFIC_PID": "x" * 200}).state["stage"] == "consent"
