"""Everybody who has to do with the short study, at the door of its application."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
from fastapi import FastAPI
from fastapi.routing import iter_route_contexts
from sqlalchemy import select

from app.services.accounts import accounts
from app.services.accounts.accounts import Role, Scope
from app.services.arrival import admission
from app.services.context import AppContext
from app.services.drafts import drafts
from app.services.sessions import advance
from app.services.studies import repository
from app.storage.models.accounts import StudyAccess
from app.storage.models.records import Job
from app.storage.models.studies import SessionRow
from app.web.http.security import SIGN_IN_COOKIE, session_cookie
from tests.databases import Databases

from .client import Api
from .role_rules import BOB, JOB, Rule

PASSWORD = "correct horse battery"
#: Who is answered so is not let in, and changes nothing.
REFUSED = (401, 403, 404)
#: What stands in a path unless its rule says otherwise: a study that is there, and made-up ids.
MADE_UP = {"slug": "short", "trial_index": 0, "form": "svg"}


def routes(application: FastAPI) -> Iterator[str]:
    """Every page and call, as `METHOD /path`."""
    for context in iter_route_contexts(application.routes):
        for method in sorted(context.methods or ()):
            if method != "HEAD":
                yield f"{method} {context.path}"


class Kept:
    """The short study with everybody who has to do with it: made once, copied for each call."""

    def __init__(self, app: AppContext, databases: Databases, folder: Path) -> None:
        study = repository.find(app, "short")
        people = {
            "admin": accounts.create(app, "admin@lab.example", PASSWORD, Role.ADMIN),
            "owner": accounts.create(app, "owner@lab.example", PASSWORD, Role.EXPERIMENTER),
            "shared": accounts.create(app, "shared@lab.example", PASSWORD, Role.EXPERIMENTER),
            "other": accounts.create(app, BOB["email"], PASSWORD, Role.EXPERIMENTER),
            "reviewer": accounts.create(app, "rev@board.example", PASSWORD, Role.REVIEWER),
        }
        owner = people["owner"]
        at = app.now()
        with app.database.write() as db:
            db.add_all(
                StudyAccess(
                    study_id=study.id,
                    account_id=people[tie].account_id,
                    access="owner" if tie == "owner" else "shared",
                    created_at=at,
                )
                # A reviewer whom it was shared with before they became one reads no data either.
                for tie in ("owner", "shared", "reviewer")
            )
            db.add(
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
        self.draft = drafts.begin(app, owner, "mine").public_id
        self.evaluators = dict(_evaluators(app))
        with app.database.read() as db:
            row = db.scalars(select(SessionRow).order_by(SessionRow.id)).all()[-1]
            self.session_id, self.participant = row.public_id, row.participant.pseudonym
        self.cookies = {
            name: accounts.sign_in(app, one.email, PASSWORD) for name, one in people.items()
        }
        self.tokens = {
            "read token": accounts.create_api_token(app, owner, "r", Scope.READ),
            "write token": accounts.create_api_token(app, owner, "w", Scope.WRITE),
        }
        self.rows = databases.keep(app.settings.url)
        self.uploads = folder / "uploads"
        shutil.copytree(app.settings.uploads_dir, self.uploads)


def _evaluators(app: AppContext) -> Iterator[tuple[str, str]]:
    """Sessions whose browsers are at these stages, by their tokens."""
    for stage in ("consent", "instructions", "query"):
        token, state = admission.start(app, "short")
        if stage != "consent":
            state = advance.consent(app, token, state["consent"]["version"])
        while stage == "query" and state["stage"] != stage:
            state = advance.continue_session(app, token)
        yield f"evaluator at {stage}", token


class House:
    """Everybody at the door of the application; each form finds things as they were."""

    def __init__(self, client: Api, app: AppContext, databases: Databases, kept: Kept) -> None:
        self._client = client
        self._studio = app
        self._databases = databases
        self._kept = kept
        self.draft = kept.draft
        self.evaluators = tuple(kept.evaluators)
        #: Of the evaluator who has come furthest.
        self.of_an_evaluator = {"session_id": kept.session_id, "participant": kept.participant}
        self.cookies = kept.cookies
        self.as_it_was()

    def as_it_was(self) -> None:
        """Everything as it was before anybody asked for anything."""
        self._is_as_it_was = True
        self._databases.put_into(self._studio.settings.url, self._kept.rows)
        uploads = self._studio.settings.uploads_dir
        shutil.copytree(self._kept.uploads, uploads, dirs_exist_ok=True)

    def ask(self, caller: str, route: str, rule: Rule) -> httpx.Response:
        """What this caller is answered; nothing of it stays."""
        method, path = route.split(" ", 1)
        if method != "GET" and not self._is_as_it_was:
            self.as_it_was()
        options: dict[str, object] = {"params": dict(rule.query)}
        if method == "POST" and not path.startswith("/api/"):
            options["data"] = {"csrf_token": self.form_token(caller), **rule.form}
        elif rule.json is not None:
            options["json"] = rule.json
        return self.send(caller, method, self.address(path, rule), **options)

    def address(self, path: str, rule: Rule) -> str:
        """Where a route is, with what its rule or the house has for each part."""
        said = self.known(rule)
        return re.sub(r"\{(\w+)\}", lambda found: said.get(found[1], "made-up"), path)

    def known(self, rule: Rule) -> dict[str, str]:
        """What the house has, and what the rule says of its path and its form."""
        said = {"public_id": self.draft, **MADE_UP, **rule.params, **rule.query, **rule.form}
        return {name: str(value) for name, value in said.items()}

    def form_token(self, caller: str) -> str:
        """What a form of our own page carries, as far as this caller can have one."""
        return hashlib.sha256(f"form:{self.cookies.get(caller, '')}".encode()).hexdigest()

    def send(self, caller: str, method: str, path: str, **options: Any) -> httpx.Response:
        """Send it with all that the caller's browser or program has."""
        headers = dict(options.pop("headers", {}))
        self._client.cookies.clear()
        if caller in self.cookies:
            self._client.cookies.set(SIGN_IN_COOKIE, self.cookies[caller])
        if caller in self._kept.evaluators:
            self._client.cookies.set(session_cookie("short"), self._kept.evaluators[caller])
        if caller in self._kept.tokens:
            headers["Authorization"] = f"Bearer {self._kept.tokens[caller]}"
        answer = self._client.request(method, path, headers=headers, **options)
        if method != "GET" and answer.status_code not in REFUSED:
            self._is_as_it_was = False
        return answer
