"""Every call of `/openapi.json`, right and wrong, by all who may ask; at length by `make fuzz`.

No call may end in a fault of the server or in an answer that the document does not tell of.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import seed as seeded

from app.services.accounts import accounts
from app.services.context import AppContext
from tests.conftest import Clock, StudyShelf
from tests.databases import Databases
from tests.fuzz import calls
from tests.fuzz.calls import Case, Operation
from tests.fuzz.person import PLAN
from tests.fuzz.plugin import Fuzz

from .client import Api
from .conftest import EMAIL, PASSWORD

PART = "calls of the document"

#: A session waits in each; the call that a stage asks for comes as far as it can there.
STAGES = (
    "consent",
    "instructions",
    "familiarisation",
    "practice",
    "query",
    "questionnaire",
    "break",
    "debrief",
    "completed",
    "withdrawn",
)
#: Where a call is most at home.
AT_HOME = {
    "consent": "consent",
    "continue": "instructions",
    "watched": "familiarisation",
    "questionnaire": "questionnaire",
}
NOBODY, EXPERIMENTER = "nobody", "experimenter"


@dataclass
class Callers:
    """Whoever calls, what they know of the study, and the study, which each finds as it was."""

    client: Api
    databases: Databases
    url: str
    kept: Any = None
    tokens: dict[str, str | None] = field(default_factory=dict)
    known: dict[str, dict[str, Any]] = field(default_factory=dict)

    def ask(self, caller: str, case: Case) -> httpx.Response:
        answer = calls.ask(self.client, case, self.tokens[caller])
        if answer.is_success and case.method != "GET":
            self.databases.put_into(self.url, self.kept)
        return answer

    def of(self, operation: Operation) -> list[str]:
        """All who try this call, those first who come furthest with it."""
        step = operation.path.removeprefix("/api/v1/session").strip("/")
        first = AT_HOME.get(step, "query") if operation.path != step else EXPERIMENTER
        return sorted(self.tokens, key=lambda caller: (caller != first, caller != NOBODY))


@pytest.fixture
def callers(
    app: AppContext,
    client: Api,
    study_shelf: StudyShelf,
    databases: Databases,
    clock: Clock,
) -> Callers:
    study_shelf.put_into(
        app, PLAN.replace("places: 2", "places: 100").replace("required: 1", "required: 0")
    )
    account = accounts.create(app, EMAIL, PASSWORD)
    made = Callers(client, databases, app.settings.url)
    made.tokens = {NOBODY: None, EXPERIMENTER: accounts.create_api_token(app, account, "tests")}
    for stage in STAGES:
        session = client.start().to_stage(stage, clock.forward)
        made.tokens[stage] = session.token
        made.known[stage] = {
            "query_id": session.state.get("query", {}).get("id", "none"),
            "version": session.state.get("consent", {}).get("version", "none"),
            "index": 0,
            "answers": {"effort": 3},
        }
    made.kept = databases.keep(app.settings.url)
    return made


def test_every_answer_is_one_that_the_document_tells_of(callers: Callers, fuzz: Fuzz) -> None:
    document = calls.read_document(callers.client)

    def hold(caller: str, operation: Operation, case: Case) -> None:
        answer = callers.ask(caller, case)
        fuzz.case(PART, operation.label, answer.status_code)
        calls.hold(case, answer)

    def at_the_edges(caller: str, operation: Operation) -> None:
        # Every few of them in a short round.
        step = 1 if fuzz.seconds else 9
        for case in islice(calls.on_the_edges(document, operation), 0, None, step):
            hold(caller, operation, case)

    def at_random(caller: str, operation: Operation, seed: int) -> None:
        @given(calls.made_up(operation, callers.known.get(caller, {})))
        def one(case: Case) -> None:
            hold(caller, operation, case)

        fuzz.settings(5)(seeded(seed)(one) if fuzz.seconds else one)()

    def one_round(seed: int) -> None:
        for operation in calls.operations(document):
            who = callers.of(operation)
            at_the_edges(who[0], operation)
            for caller in who if fuzz.seconds else who[:1]:
                at_random(caller, operation, seed)

    fuzz.rounds(PART, one_round)


def test_the_document_says_of_each_call_who_may_ask_and_what_comes_back(client: Api) -> None:
    document = client.get("/openapi.json").json()
    schemes = document["components"]["securitySchemes"]
    assert schemes.keys() == {"session", "experimenter", "machine"}
    found = [
        (f"{method.upper()} {path}", call)
        for path, calls_there in document["paths"].items()
        for method, call in calls_there.items()
    ]
    assert len({call["operationId"] for _, call in found}) == len(found)
    for label, call in found:
        assert call["summary"], label
        assert call["description"], label
        # Whoever holds a receipt needs nothing else.
        assert "security" in call or label.endswith("/deletions"), label
        for status, answer in call["responses"].items():
            if status >= "400":
                assert answer["content"].keys() == {"application/problem+json"}, (label, status)
            elif status != "204":
                assert all(said["schema"] for said in answer["content"].values()), (label, status)
        takes_a_body = "requestBody" in call
        assert {"422", "503"} <= call["responses"].keys(), label
        assert ({"400", "413"} <= call["responses"].keys()) == takes_a_body, label
