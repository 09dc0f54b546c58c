"""Every caller tries every page and call; `role_rules` says what each comes to."""

from __future__ import annotations

import hashlib

import httpx
import pytest
from fastapi import FastAPI

from app.services.runtime.settings import Settings
from app.web.http.security import SIGN_IN_COOKIE

from .client import Api
from .house import House, routes
from .role_rules import ANYBODY, CALLERS, IN, RULES, SIGN_IN, Verdict


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """No browser: who may have the ethics bundle does not hang on its pictures."""
    return settings.model_copy(update={"chromium": "no-such-browser"})


def test_every_route_has_a_rule(application: FastAPI) -> None:
    found = set(routes(application))
    without = sorted(found - RULES.keys())
    assert not without, (
        "say in tests/functional/role_rules.py who may do this (its first lines say how): "
        + "; ".join(without)
    )
    assert not RULES.keys() - found, f"rules of what is not there: {RULES.keys() - found}"


def verdict(answer: httpx.Response, *, made_up: bool) -> Verdict:
    """What an answer comes to. made_up: the path names something that is not there."""
    if answer.status_code == 303 and answer.headers["location"].startswith("/sign-in?"):
        return SIGN_IN
    if answer.status_code in (401, 403) or (answer.status_code == 404 and not made_up):
        return answer.status_code
    assert answer.status_code < 500, answer.text
    return IN


@pytest.mark.parametrize("route", [route for route, rule in RULES.items() if rule is not ANYBODY])
def test_each_caller_comes_to_what_the_rule_says(house: House, route: str) -> None:
    rule = RULES[route]
    found = {}
    for caller in CALLERS:
        # Only who is let in may learn that what the path or the form names is not there.
        is_in = rule.expected(caller) == IN
        found[caller] = verdict(house.ask(caller, route, rule), made_up=is_in)
    assert found == {caller: rule.expected(caller) for caller in CALLERS}, rule.name


@pytest.mark.parametrize("route", [route for route, rule in RULES.items() if rule is ANYBODY])
def test_where_anybody_may_an_account_makes_no_difference(house: House, route: str) -> None:
    rule = RULES[route]
    callers = ("admin", "other", "reviewer")
    statuses = {caller: house.ask(caller, route, rule).status_code for caller in callers}
    assert len(set(statuses.values())) == 1, statuses
    if not route.startswith("POST /") or route.startswith(("POST /s/", "POST /api/")):
        assert house.ask("nobody", route, rule).status_code == statuses["admin"]


@pytest.mark.parametrize(
    "route",
    [
        route
        for route, rule in RULES.items()
        if route.startswith("POST ")
        and not route.startswith(("POST /api/", "POST /s/", "POST /preview/s/", "POST /pilot/s/"))
        and rule is not ANYBODY
    ],
)
def test_no_form_is_taken_that_another_site_could_have_sent(
    client: Api, house: House, route: str
) -> None:
    """The right cookies, and not what only a page of ours knows."""
    rule = RULES[route]
    method, path = route.split(" ", 1)
    path = house.address(path, rule)
    caller = "owner" if "/drafts" in path else "admin"
    house.as_it_was()
    client.cookies.set(SIGN_IN_COOKIE, house.cookies[caller])
    for token in ("0" * 64, hashlib.sha256(b"form:").hexdigest()):
        answer = client.request(method, path, data={"csrf_token": token, **rule.form})
        assert answer.status_code == 403, (token, answer.text)
    without = client.request(method, path, data=dict(rule.form))
    assert without.status_code in (403, 422)
