"""What ends with a password, a role or an account: every sign-in, API token and open link of it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from app.services.accounts import accounts, administration, invitations, own_account
from app.services.accounts.accounts import Role
from app.services.context import AppContext
from app.services.runtime.errors import ForbiddenError, InvitationError, SignInRequiredError
from app.services.studies.repository import StudyInfo

from .client import Api
from .conftest import EMAIL, PASSWORD
from .test_accounts import BOB, NEW_PASSWORD, choose, link_in, send
from .test_experimenter_pages import COOKIE, sign_in

TABLE = "/api/v1/studies/short/export/queries.csv"


class Held:
    """All that lets its holder in as Bob: a cookie, an API token, and a reset link."""

    def __init__(self, client: Api, app: AppContext) -> None:
        self.bob = accounts.create(app, BOB, PASSWORD, Role.ADMIN)
        self.client, self.app = client, app
        self.cookie = accounts.sign_in(app, BOB, PASSWORD)
        self.token = accounts.create_api_token(app, self.bob, "made by a burglar")
        self.link = invitations.reset(app, BOB, EMAIL)

    def works(self) -> dict[str, bool]:
        self.client.cookies.clear()
        self.client.cookies.set(COOKIE, self.cookie)
        by_cookie = self.client.get("/studies").status_code == 200
        self.client.cookies.clear()
        bearer = {"Authorization": f"Bearer {self.token}"}
        return {
            "cookie": by_cookie,
            "token": self.client.get(TABLE, headers=bearer).status_code == 200,
            "link": self.client.get(self.link).status_code == 200,
        }


@pytest.fixture
def held(client: Api, app: AppContext, short_study: StudyInfo, api_token: str) -> Held:
    found = Held(client, app)
    assert found.works() == {"cookie": True, "token": True, "link": True}
    return found


NOTHING = {"cookie": False, "token": False, "link": False}


def test_an_own_change_of_password_ends_all_but_the_browser_that_asked(held: Held) -> None:
    held.client.cookies.clear()
    assert sign_in(held.client, BOB, PASSWORD).status_code == 303
    page = held.client.get("/account").text
    assert "signs out all other browsers and ends your 1 API token " in page
    given = {"old": PASSWORD, "new": NEW_PASSWORD, "again": NEW_PASSWORD}
    assert send(held.client, "/account/password", "/account", **given).status_code == 303
    assert held.client.get("/account").status_code == 200
    assert held.works() == NOTHING


def test_a_used_reset_link_ends_everything(held: Held) -> None:
    held.client.cookies.clear()
    assert choose(held.client, held.link, NEW_PASSWORD).status_code == 200
    assert held.works() == NOTHING


ENDINGS: dict[str, Callable[[AppContext], None]] = {
    "reset by an operator": lambda app: accounts.set_password(app, BOB, NEW_PASSWORD),
    "disabled": lambda app: administration.disable(app, BOB, EMAIL),
    "another role": lambda app: administration.change_role(app, BOB, Role.EXPERIMENTER, EMAIL),
}


@pytest.mark.parametrize("how", ENDINGS)
def test_whatever_changes_an_account_ends_the_ways_into_it(held: Held, how: str) -> None:
    ENDINGS[how](held.app)
    assert held.works() == NOTHING
    administration.enable(held.app, BOB, EMAIL)
    assert held.works() == NOTHING


def test_enabling_revives_no_token_that_an_earlier_version_left(held: Held) -> None:
    administration.disable(held.app, BOB, EMAIL)
    token = accounts.create_api_token(held.app, held.bob, "left")
    administration.enable(held.app, BOB, EMAIL)
    with pytest.raises(SignInRequiredError):
        accounts.by_api_token(held.app, token)


def test_a_reset_link_made_before_an_own_change_is_worth_nothing(
    client: Api, app: AppContext, short_study: StudyInfo, api_token: str
) -> None:
    assert sign_in(client).status_code == 303
    accounts.create(app, BOB, PASSWORD)
    link = link_in(send(client, "/accounts/reset", email=BOB))
    bob = accounts.by_sign_in(app, accounts.sign_in(app, BOB, PASSWORD))
    own_account.change_password(app, bob, PASSWORD, NEW_PASSWORD)
    assert client.get(link).status_code == 410
    with pytest.raises(InvitationError):
        invitations.accept(app, link.rsplit("/", 1)[1], PASSWORD)


def test_other_accounts_keep_what_they_have(held: Held) -> None:
    token = accounts.create_api_token(held.app, accounts.find(held.app, EMAIL), "hers")
    administration.disable(held.app, BOB, EMAIL)
    assert accounts.by_api_token(held.app, token).email == EMAIL


def test_a_password_that_is_reset_while_it_is_looked_at_lets_nobody_in(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = accounts.is_password_of

    def slowly(account: object, password: str) -> bool:
        is_right = looked_at(account, password)  # type: ignore[arg-type]
        if is_right:
            accounts.set_password(held.app, BOB, NEW_PASSWORD)
        return is_right

    monkeypatch.setattr(accounts, "is_password_of", slowly)
    with pytest.raises(SignInRequiredError):
        accounts.sign_in(held.app, BOB, PASSWORD)
    accounts.set_password(held.app, BOB, PASSWORD)
    caller = accounts.find(held.app, BOB)
    with pytest.raises(ForbiddenError, match="changed meanwhile"):
        own_account.change_password(held.app, caller, PASSWORD, "what a burglar wants")


def test_an_ended_sign_in_makes_no_token(held: Held) -> None:
    bob = accounts.by_sign_in(held.app, held.cookie)
    accounts.set_password(held.app, BOB, NEW_PASSWORD)
    with pytest.raises(SignInRequiredError):
        accounts.create_api_token(held.app, bob, "too late")
