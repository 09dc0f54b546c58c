"""Every page and every form, filled in as nobody does: nothing is a fault of the server's.

Whoever sends it is let in, so that what is behind the door is tried. At length by `make fuzz`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import seed as seeded

from app.services.runtime.settings import Settings
from tests.fuzz import forms
from tests.fuzz.plugin import Fuzz

from .client import Api
from .house import House
from .role_rules import IN, RULES

PART = "hostile forms and addresses"

#: Streams, and what other processes are begun for: they have tests of their own.
LEFT_OUT = {
    "POST /drafts/{public_id}/transcode",
    "POST /studies/{slug}/simulate",
}


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """No browser: it would take pictures for the ethics bundle."""
    return settings.model_copy(update={"chromium": "no-such-browser"})


def let_in(house: House, route: str, seed: int) -> str:
    """Somebody at a browser who is let in: the owner, if they are; of a session its evaluator."""
    if "/s/{slug}" in route:
        return house.evaluators[seed % len(house.evaluators)]
    rule = RULES[route]
    return next(caller for caller in ("owner", "admin", "nobody") if rule.expected(caller) == IN)


def names_of_fields(house: House, targets: Sequence[forms.Target]) -> list[str]:
    """Those of all forms on all pages."""
    found = set()
    for target in targets:
        if target.method == "GET":
            caller = let_in(house, target.route, 0)
            page = house.ask(caller, target.route, RULES[target.route]).text
            found |= set(re.findall(r'name="([\w-]+)"', page))
    return sorted(found - {"csrf_token"})


# Starlette leaves the file of a form that breaks off to be closed by itself.
@pytest.mark.filterwarnings("ignore:Unclosed file <tempfile.SpooledTemporaryFile:ResourceWarning")
def test_nothing_that_is_filled_in_is_a_fault_of_the_server(
    application: FastAPI, client: Api, house: House, fuzz: Fuzz
) -> None:
    described = client.get("/openapi.json").json()["paths"]
    targets = [
        target for target in forms.targets(application, described) if target.route not in LEFT_OUT
    ]
    names = names_of_fields(house, targets)
    assert len(names) > 20

    def one_round(seed: int) -> None:
        for target in targets:
            house.as_it_was()
            try_it(target, seed)

    def try_it(target: forms.Target, seed: int) -> None:
        caller = let_in(house, target.route, seed)
        figure = "path" if "{session_id}" in target.path else "acquired-on-w"
        known = {**house.of_an_evaluator, "name": figure, **house.known(RULES[target.route])}

        @given(forms.made_up(target, known, house.form_token(caller), names))
        def one(sent: forms.Sent) -> None:
            headers = {"Content-Type": sent.content_type} if sent.content is not None else {}
            try:
                answer = house.send(
                    caller, target.method, sent.address, content=sent.content, headers=headers
                )
                assert answer.status_code < 500, answer.text
            except Exception as fault:
                fault.add_note(f"{caller}: {target.method} {sent}")
                raise
            fuzz.case(PART, target.route, answer.status_code)
            if target.method == "POST" and answer.status_code in (200, 303):
                house.as_it_was()

        fuzz.settings(1)(seeded(seed)(one) if fuzz.seconds else one)()

    fuzz.rounds(PART, one_round)
