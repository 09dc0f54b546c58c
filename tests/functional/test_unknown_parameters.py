"""A query parameter that a route does not have is refused by name, unless others add theirs."""

from __future__ import annotations

import pytest
from fastapi import FastAPI

from app.services.studies.repository import StudyInfo

from .client import Api
from .house import House, routes
from .role_rules import RULES

#: Addresses that platforms, mail programs, players and monitors add parameters of theirs to.
OPEN = ("/s/", "/preview/s/", "/pilot/s/", "/media/", "/sign-in", "/sign-out", "/invitations/")
OF_NOBODY = ("/healthz", "/readyz", "/metrics", "/styles/", "/openapi.json", "/static")


def is_open(route: str) -> bool:
    path = route.split(" ", 1)[1]
    return path == "/" or path.startswith((*OPEN, *OF_NOBODY))


def test_what_no_route_has_is_refused_by_every_other_route(
    application: FastAPI, house: House
) -> None:
    asked = [route for route in routes(application) if not is_open(route)]
    assert len(asked) > 80
    for route in asked:
        method, path = route.split(" ", 1)
        rule = RULES[route]
        address = house.address(path, rule)
        answer = house.send("owner", method, f"{address}?mood=live")
        assert answer.status_code == 422, route
        assert "query/mood: expected" in answer.text, route
        if path.startswith("/api/"):
            assert answer.json()["type"].endswith(":invalid"), route
            assert answer.json()["errors"][0]["pointer"] == "query/mood", route


def test_what_a_route_has_is_taken(application: FastAPI, house: House) -> None:
    asked = [route for route, rule in RULES.items() if rule.query and not is_open(route)]
    assert asked
    for route in asked:
        assert "query/" not in house.ask("owner", route, RULES[route]).text, route


@pytest.mark.parametrize("path", ["/s/short", "/s/short/privacy", "/sign-in", "/healthz"])
def test_where_others_add_their_own_nothing_is_refused(
    client: Api, short_study: StudyInfo, path: str
) -> None:
    assert client.get(f"{path}?utm_source=mail&fbclid=1").status_code == 200


def test_a_misspelt_one_is_told_the_right_one(house: House) -> None:
    for path, meant in (
        ("/api/v1/studies/short/rollouts?statu=asked", "did you mean status?"),
        ("/studies/short/activity?befor=3", "did you mean before?"),
        ("/api/v1/session?study=short", "query/study: expected no parameter"),
    ):
        answer = house.send("owner", "GET", path)
        assert answer.status_code == 422
        assert meant in answer.text
