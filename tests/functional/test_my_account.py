"""What everybody does with their own account, and how often a password may be tried."""

from __future__ import annotations

import re

import httpx
import pytest
from sqlalchemy import func, select

from app.services.accounts import accounts
from app.services.accounts.accounts import Scope
from app.services.context import AppContext
from app.services.studies.repository import StudyInfo
from app.storage.models.accounts import FailedSignIn
from tests.conftest import Clock, database_file

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_accounts import BOB, NEW_PASSWORD, send
from .test_experimenter_pages import COOKIE, form_token, sign_in


@pytest.fixture
def signed_in(client: Api, short_study: StudyInfo, api_token: str) -> Api:
    assert sign_in(client).status_code == 303
    return client


def change(client: Api, old: str, new: str, again: str | None = None) -> httpx.Response:
    given = {"old": old, "new": new, "again": new if again is None else again}
    return send(client, "/account/password", "/account", **given)


def make_token(client: Api, **given: str) -> httpx.Response:
    fields = {"label": "notebook", "scope": "read", "days": "30", **given}
    return send(client, "/account/tokens", "/account", **fields)


def shown_token(page: httpx.Response) -> str:
    found = re.search(r'data-testid="api-token">([\w-]{43})<', page.text)
    assert found, page.text
    return found[1]


def test_a_new_password_signs_out_all_other_browsers(signed_in: Api, app: AppContext) -> None:
    elsewhere = accounts.sign_in(app, EMAIL, PASSWORD)
    assert change(signed_in, PASSWORD, NEW_PASSWORD).headers["location"].startswith("/account")
    assert "is changed" in signed_in.get("/account?changed=password").text
    signed_in.cookies.set(COOKIE, elsewhere)
    assert signed_in.get("/account").status_code == 303
    signed_in.cookies.clear()
    assert sign_in(signed_in, password=PASSWORD).status_code == 401
    assert sign_in(signed_in, password=NEW_PASSWORD).status_code == 303


def test_a_password_is_changed_only_by_who_knows_the_present_one(signed_in: Api) -> None:
    for old, new, again, said in [
        ("wrong", NEW_PASSWORD, None, "not the present password"),
        (PASSWORD, "short", None, "at least 10 characters"),
        (PASSWORD, NEW_PASSWORD, PASSWORD, "not the same"),
    ]:
        page = change(signed_in, old, new, again)
        assert (page.status_code, said in page.text) == (409, True)
    signed_in.cookies.clear()
    assert sign_in(signed_in).status_code == 303


def test_the_present_password_cannot_be_guessed_either(signed_in: Api) -> None:
    for number in range(10):
        assert change(signed_in, f"guess {number}", NEW_PASSWORD).status_code == 409
    assert change(signed_in, PASSWORD, NEW_PASSWORD).status_code == 429


def test_sign_ins_are_ended_one_by_one_and_all_at_once(signed_in: Api, app: AppContext) -> None:
    others = [accounts.sign_in(app, EMAIL, PASSWORD) for _ in range(3)]
    page = signed_in.get("/account").text
    assert page.count("This browser") == 1
    paths = re.findall(r"/account/sign-ins/\d+/end", page)
    assert len(paths) == 3
    assert send(signed_in, paths[0], "/account").status_code == 303
    assert send(signed_in, paths[0], "/account").status_code == 404
    assert len(re.findall(r"/sign-ins/\d+/end", signed_in.get("/account").text)) == 2
    assert send(signed_in, "/account/sign-ins/end-others", "/account").status_code == 303
    assert signed_in.get("/account").status_code == 200
    for other in others:
        signed_in.cookies.set(COOKIE, other)
        assert signed_in.get("/account").status_code == 303


def test_nobody_ends_sign_ins_or_tokens_of_somebody_else(signed_in: Api, app: AppContext) -> None:
    bob = accounts.create(app, BOB, PASSWORD)
    his = accounts.by_sign_in(app, accounts.sign_in(app, BOB, PASSWORD)).sign_in_id
    token = accounts.create_api_token(app, bob, "his")
    assert send(signed_in, f"/account/sign-ins/{his}/end", "/account").status_code == 404
    for number in range(1, 4):
        send(signed_in, f"/account/tokens/{number}/revoke", "/account")
    assert accounts.by_api_token(app, token).email == BOB


@pytest.mark.sqlite
def test_a_token_is_shown_once_kept_as_a_hash_and_revoked(signed_in: Api, app: AppContext) -> None:
    token = shown_token(make_token(signed_in))
    assert token not in signed_in.get("/account").text
    file = database_file(app.settings)
    for path in (file, file.with_name(f"{file.name}-wal")):
        assert token.encode() not in path.read_bytes()
    assert accounts.by_api_token(app, token).scope is Scope.READ
    bearer = {"Authorization": f"Bearer {token}"}
    table = "/api/v1/studies/short/export/queries.csv"
    revoke = re.findall(r"/account/tokens/\d+/revoke", signed_in.get("/account").text)
    assert len(revoke) == 2  # of the fixture, and this one, the newest first
    csrf = form_token(signed_in.get("/account"))
    signed_in_cookie = signed_in.cookies[COOKIE]
    signed_in.cookies.clear()
    assert signed_in.get(table, headers=bearer).status_code == 200
    signed_in.cookies.set(COOKIE, signed_in_cookie)
    assert signed_in.post(revoke[0], data={"csrf_token": csrf}).status_code == 303
    signed_in.cookies.clear()
    assert signed_in.get(table, headers=bearer).status_code == 401


def test_a_token_is_good_for_as_long_as_was_asked(
    signed_in: Api, app: AppContext, clock: Clock
) -> None:
    token = shown_token(make_token(signed_in, days="1"))
    clock.forward(24 * 3600 - 1)
    assert accounts.by_api_token(app, token).email == EMAIL
    clock.forward(1)
    assert "Expired" in signed_in.get("/account").text


@pytest.mark.parametrize(
    ("given", "status"),
    [
        ({"label": "  "}, 409),
        ({"label": "x" * 101}, 409),
        ({"days": "0"}, 409),
        ({"days": "366"}, 409),
        ({"days": "soon"}, 422),
        ({"scope": "everything"}, 422),
    ],
)
def test_what_no_token_can_be_is_refused(
    signed_in: Api, given: dict[str, str], status: int
) -> None:
    assert make_token(signed_in, **given).status_code == status


def test_a_token_makes_no_tokens_and_changes_no_password(signed_in: Api, app: AppContext) -> None:
    """Also not with a cookie of its own, from which it could work out what a form must hold."""
    token = accounts.create_api_token(app, accounts.find(app, EMAIL), "write")
    signed_in.cookies.clear()
    form = form_token(signed_in.get("/sign-in"))
    bearer = {"Authorization": f"Bearer {token}"}
    assert signed_in.get("/account", headers=bearer).status_code == 403
    for path, given in {
        "/account/tokens": {"label": "more", "scope": "write", "days": "365"},
        "/account/password": {"old": PASSWORD, "new": NEW_PASSWORD, "again": NEW_PASSWORD},
        "/accounts/invite": {"email": BOB, "role": "admin"},
    }.items():
        answer = signed_in.post(path, data={"csrf_token": form, **given}, headers=bearer)
        assert answer.status_code == 403, path


# How often a password may be tried


@pytest.mark.parametrize("address", [EMAIL, "nobody@lab.example"])
def test_after_ten_tries_each_further_one_has_to_wait_longer(
    client: Api, api_token: str, clock: Clock, address: str
) -> None:
    for number in range(10):
        assert sign_in(client, address, f"guess number {number}").status_code == 401
    for wait, said in ((30, "in 30 s"), (60, "in 60 s"), (120, "in 2 minutes"), (240, "4 minutes")):
        refusal = sign_in(client, address, PASSWORD)
        assert refusal.status_code == 429
        assert said in refusal.text
        assert refusal.headers["retry-after"] == str(wait)
        assert COOKIE not in client.cookies
        # What is refused is not counted: waiting helps.
        clock.forward(wait - 1)
        assert sign_in(client, address, PASSWORD).status_code == 429
        clock.forward(1)
        if wait < 240:
            assert sign_in(client, address, "guess again").status_code == 401
    assert sign_in(client, address, PASSWORD).status_code == (303 if address == EMAIL else 401)


def test_addresses_are_counted_apart_and_however_they_are_typed(
    client: Api, app: AppContext, api_token: str
) -> None:
    for number in range(10):
        sign_in(client, f" {EMAIL.upper() if number % 2 else EMAIL}", "guess number")
    accounts.create(app, BOB, PASSWORD)
    assert sign_in(client, EMAIL, PASSWORD).status_code == 429
    assert sign_in(client, BOB, PASSWORD).status_code == 303


def test_who_gets_in_begins_to_count_anew(client: Api, api_token: str) -> None:
    for _ in range(2):
        for number in range(9):
            assert sign_in(client, EMAIL, f"guess {number}").status_code == 401
        assert sign_in(client).status_code == 303


@pytest.mark.sqlite
def test_tries_are_kept_for_minutes_and_without_the_address(
    client: Api, app: AppContext, api_token: str, clock: Clock
) -> None:
    sign_in(client, "nobody@home.example", "guess number 1")
    clock.forward(15 * 60)
    sign_in(client, "somebody@home.example", "guess number 2")
    with app.database.read() as db:
        assert db.scalar(select(func.count(FailedSignIn.id))) == 1
    assert b"home.example" not in database_file(app.settings).read_bytes()
