"""Every caller tries every page and call; `role_rules` says what each comes to."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from fastapi.routing import iter_route_contexts

from app.services import accounts, drafts, studies
from app.services.accounts import Role, Scope
from app.services.settings import Settings
from app.services.studio import Studio, open_studio
from app.storage.accounts import StudyAccess
from app.storage.records import Job
from tests.conftest import SHORT_PLAN, Clock, Idle, StudyShelf
from tests.databases import Databases

from .client import Api
from .conftest import EMAIL, PASSWORD
from .role_rules import ANYBODY, BOB, CALLERS, IN, JOB, RULES, SIGN_IN, Rule, Verdict
from .test_experimenter_pages import COOKIE

#: What stands in a path unless its rule says otherwise: a study that is there, and made-up ids.
MADE_UP = {"slug": "short", "trial_index": 0, "form": "svg"}


def routes(application: FastAPI) -> Iterator[str]:
    """Every page and call, as `METHOD /path`."""
    for context in iter_route_contexts(application.routes):
        for method in sorted(context.methods or ()):
            if method != "HEAD":
                yield f"{method} {context.path}"


def test_every_route_has_a_rule(application: FastAPI) -> None:
    found = set(routes(application))
    without = sorted(found - RULES.keys())
    assert not without, (
        "say in tests/functional/role_rules.py who may do this (its first lines say how): "
        + "; ".join(without)
    )
    assert not RULES.keys() - found, f"rules of what is not there: {RULES.keys() - found}"


class Kept:
    """The short study with everybody who has to do with it: made once, copied for each call."""

    def __init__(self, studio: Studio, databases: Databases, folder: Path) -> None:
        study = studies.find(studio, "short")
        people = {
            "admin": accounts.create(studio, EMAIL, PASSWORD, Role.ADMIN),
            "owner": accounts.create(studio, "owner@lab.example", PASSWORD, Role.EXPERIMENTER),
            "shared": accounts.create(studio, "shared@lab.example", PASSWORD, Role.EXPERIMENTER),
            "other": accounts.create(studio, BOB["email"], PASSWORD, Role.EXPERIMENTER),
            "reviewer": accounts.create(studio, "rev@board.example", PASSWORD, Role.REVIEWER),
        }
        owner = people["owner"]
        at = studio.now()
        with studio.database.write() as session:
            session.add_all(
                StudyAccess(
                    study_id=study.id,
                    account_id=people[tie].account_id,
                    access="owner" if tie == "owner" else "shared",
                    created_at=at,
                )
                # A reviewer whom it was shared with before they became one reads no data either.
                for tie in ("owner", "shared", "reviewer")
            )
            session.add(
                Job(
                    public_id=JOB,
                    account_id=owner.account_id,
                    kind="simulate",
                    state="done",
                    done=1,
                    total=1,
                    request={},
                    created_at=at,
                )
            )
        self.draft = drafts.begin(studio, owner, "mine").public_id
        self.cookies = {
            name: accounts.sign_in(studio, one.email, PASSWORD) for name, one in people.items()
        }
        self.tokens = {
            "read token": accounts.create_api_token(studio, owner, "r", Scope.READ),
            "write token": accounts.create_api_token(studio, owner, "w", Scope.WRITE),
        }
        self.database = databases.new(folder)
        databases.copy(studio.settings.url, self.database)
        self.uploads = folder / "uploads"
        shutil.copytree(studio.settings.uploads_dir, self.uploads)


@pytest.fixture(scope="module")
def kept(
    databases: Databases,
    study_shelf: StudyShelf,
    media_dir: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Kept:
    folder = tmp_path_factory.mktemp("house")
    settings = Settings(
        data_dir=folder / "data",
        media_dir=media_dir,
        database_url=databases.new(folder / "data"),
    )
    studio = open_studio(settings, now=Clock().now, background=Idle(1))
    study_shelf.put_into(studio, SHORT_PLAN)
    made = Kept(studio, databases, folder / "kept")
    studio.close()
    return made


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """No browser: who may have the ethics bundle does not hang on its pictures."""
    return settings.model_copy(update={"chromium": "no-such-browser"})


class House:
    """Everybody at the door of the application; each form finds things as they were."""

    def __init__(self, client: Api, studio: Studio, databases: Databases, kept: Kept) -> None:
        self._client = client
        self._studio = studio
        self._databases = databases
        self._kept = kept
        self.draft = kept.draft
        self.cookies = kept.cookies
        self.as_it_was()

    def as_it_was(self) -> None:
        """Everything as it was before anybody asked for anything."""
        self._databases.copy(self._kept.database, self._studio.settings.url)
        uploads = self._studio.settings.uploads_dir
        shutil.copytree(self._kept.uploads, uploads, dirs_exist_ok=True)

    def ask(self, caller: str, route: str, rule: Rule) -> httpx.Response:
        """What this caller is answered; nothing of it stays."""
        method, path = route.split(" ", 1)
        if method != "GET":
            self.as_it_was()
        said = {"public_id": self.draft, **MADE_UP, **rule.params}
        path = re.sub(r"\{(\w+)\}", lambda found: str(said.get(found[1], "made-up")), path)
        headers = {}
        self._client.cookies.clear()
        if caller in self.cookies:
            self._client.cookies.set(COOKIE, self.cookies[caller])
        if caller in self._kept.tokens:
            headers["Authorization"] = f"Bearer {self._kept.tokens[caller]}"
        options: dict[str, object] = {"headers": headers, "params": dict(rule.query)}
        if method == "POST" and not path.startswith("/api/"):
            # A form of our own page, as far as this caller can have one.
            secret = self._client.cookies.get(COOKIE, "")
            token = hashlib.sha256(f"form:{secret}".encode()).hexdigest()
            options["data"] = {"csrf_token": token, **rule.form}
        elif rule.json is not None:
            options["json"] = rule.json
        return self._client.request(method, path, **options)


@pytest.fixture
def house(
    client: Api, application: FastAPI, studio: Studio, databases: Databases, kept: Kept
) -> Iterator[House]:
    # Streams end at once, as they do when a server is told to stop.
    before = application.state.stopping
    application.state.stopping = lambda: True
    yield House(client, studio, databases, kept)
    application.state.stopping = before


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
        and not route.startswith(("POST /api/", "POST /s/"))
        and rule is not ANYBODY
    ],
)
def test_no_form_is_taken_that_another_site_could_have_sent(
    client: Api, house: House, route: str
) -> None:
    """The right cookies, and not what only a page of ours knows."""
    rule = RULES[route]
    method, path = route.split(" ", 1)
    said = {"public_id": house.draft, **MADE_UP, **rule.params}
    path = re.sub(r"\{(\w+)\}", lambda found: str(said.get(found[1], "made-up")), path)
    caller = "owner" if "/drafts" in path else "admin"
    house.as_it_was()
    client.cookies.set(COOKIE, house.cookies[caller])
    for token in ("0" * 64, hashlib.sha256(b"form:").hexdigest()):
        answer = client.request(method, path, data={"csrf_token": token, **rule.form})
        assert answer.status_code == 403, (token, answer.text)
    without = client.request(method, path, data=dict(rule.form))
    assert without.status_code in (403, 422)
