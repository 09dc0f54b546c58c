"""Who runs studies: passwords, sign-ins and API tokens."""

from __future__ import annotations

import pytest

from app.services.accounts import accounts
from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError, SignInRequiredError
from app.services.runtime.ids import secret_hash
from app.storage.models.accounts import Account, ApiToken, SignIn
from tests.conftest import Clock

EMAIL, PASSWORD = "ada@lab.example", "correct horse battery"


@pytest.fixture
def ada(app: AppContext) -> accounts.Principal:
    return accounts.create(app, EMAIL, PASSWORD)


def test_an_address_is_the_same_however_it_is_typed(
    app: AppContext, ada: accounts.Principal
) -> None:
    assert accounts.find(app, " Ada@Lab.Example ") == ada
    with pytest.raises(ConflictError, match="has an account"):
        accounts.create(app, "ADA@LAB.EXAMPLE", PASSWORD)


@pytest.mark.parametrize("email", ["ada", "@", "ada@", "@lab.example", ""])
def test_what_is_no_address_is_refused(app: AppContext, email: str) -> None:
    with pytest.raises(ConflictError, match="expected an e-mail address"):
        accounts.create(app, email, PASSWORD)


def test_a_short_password_is_refused_without_being_repeated(app: AppContext) -> None:
    with pytest.raises(ConflictError, match="at least 10 characters, got 9") as refused:
        accounts.create(app, EMAIL, "123456789")
    assert "123456789" not in str(refused.value)


def test_another_password_signs_every_browser_out(app: AppContext, ada: accounts.Principal) -> None:
    token = accounts.sign_in(app, EMAIL, PASSWORD)
    accounts.set_password(app, EMAIL, "another good one")
    with pytest.raises(SignInRequiredError):
        accounts.by_sign_in(app, token)
    with pytest.raises(SignInRequiredError):
        accounts.sign_in(app, EMAIL, PASSWORD)
    assert accounts.by_sign_in(app, accounts.sign_in(app, EMAIL, "another good one")) == ada


def test_nobodys_password_cannot_be_changed(app: AppContext) -> None:
    with pytest.raises(NotFoundError, match="bob"):
        accounts.set_password(app, "bob@lab.example", PASSWORD)


def test_a_sign_in_is_no_api_token_and_an_api_token_no_sign_in(
    app: AppContext, ada: accounts.Principal
) -> None:
    signed_in = accounts.sign_in(app, EMAIL, PASSWORD)
    api_token = accounts.create_api_token(app, ada, "tests")
    assert accounts.by_api_token(app, api_token) == ada
    with pytest.raises(SignInRequiredError):
        accounts.by_api_token(app, signed_in)
    with pytest.raises(SignInRequiredError):
        accounts.by_sign_in(app, api_token)


def test_old_sign_ins_are_cleared_away(
    app: AppContext, ada: accounts.Principal, clock: Clock
) -> None:
    accounts.sign_in(app, EMAIL, PASSWORD)
    clock.forward(accounts.SIGN_IN_LASTS.total_seconds() + 1)
    accounts.sign_in(app, EMAIL, PASSWORD)
    with app.database.read() as db:
        assert db.query(SignIn).count() == 1


def test_the_database_holds_no_password_and_no_token(
    app: AppContext, ada: accounts.Principal
) -> None:
    token = accounts.create_api_token(app, ada, "tests")
    with app.database.read() as db:
        assert db.query(Account).one().password_hash.startswith("$argon2id$")
        assert db.query(ApiToken).one().token_hash == secret_hash(token) != token
