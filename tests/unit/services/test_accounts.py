"""Who runs studies: passwords, sign-ins and API tokens."""

from __future__ import annotations

import pytest

from app.services import accounts
from app.services.errors import ConflictError, NotFoundError, SignInRequiredError
from app.services.studio import Studio
from app.services.tokens import secret_hash
from app.storage.accounts import Account, ApiToken, SignIn
from tests.conftest import Clock

EMAIL, PASSWORD = "ada@lab.example", "correct horse battery"


@pytest.fixture
def ada(studio: Studio) -> accounts.Experimenter:
    return accounts.create(studio, EMAIL, PASSWORD)


def test_an_address_is_the_same_however_it_is_typed(
    studio: Studio, ada: accounts.Experimenter
) -> None:
    assert accounts.find(studio, " Ada@Lab.Example ") == ada
    with pytest.raises(ConflictError, match="has an account"):
        accounts.create(studio, "ADA@LAB.EXAMPLE", PASSWORD)


@pytest.mark.parametrize("email", ["ada", "@", "ada@", "@lab.example", ""])
def test_what_is_no_address_is_refused(studio: Studio, email: str) -> None:
    with pytest.raises(ConflictError, match="expected an e-mail address"):
        accounts.create(studio, email, PASSWORD)


def test_a_short_password_is_refused_without_being_repeated(studio: Studio) -> None:
    with pytest.raises(ConflictError, match="at least 10 characters, got 9") as refused:
        accounts.create(studio, EMAIL, "123456789")
    assert "123456789" not in str(refused.value)


def test_another_password_signs_every_browser_out(
    studio: Studio, ada: accounts.Experimenter
) -> None:
    token = accounts.sign_in(studio, EMAIL, PASSWORD)
    accounts.set_password(studio, EMAIL, "another good one")
    with pytest.raises(SignInRequiredError):
        accounts.by_sign_in(studio, token)
    with pytest.raises(SignInRequiredError):
        accounts.sign_in(studio, EMAIL, PASSWORD)
    assert accounts.by_sign_in(studio, accounts.sign_in(studio, EMAIL, "another good one")) == ada


def test_nobodys_password_cannot_be_changed(studio: Studio) -> None:
    with pytest.raises(NotFoundError, match="bob"):
        accounts.set_password(studio, "bob@lab.example", PASSWORD)


def test_a_sign_in_is_no_api_token_and_an_api_token_no_sign_in(
    studio: Studio, ada: accounts.Experimenter
) -> None:
    signed_in = accounts.sign_in(studio, EMAIL, PASSWORD)
    api_token = accounts.create_api_token(studio, ada, "tests")
    assert accounts.by_api_token(studio, api_token) == ada
    with pytest.raises(SignInRequiredError):
        accounts.by_api_token(studio, signed_in)
    with pytest.raises(SignInRequiredError):
        accounts.by_sign_in(studio, api_token)


def test_old_sign_ins_are_cleared_away(
    studio: Studio, ada: accounts.Experimenter, clock: Clock
) -> None:
    accounts.sign_in(studio, EMAIL, PASSWORD)
    clock.forward(accounts.SIGN_IN_LASTS.total_seconds() + 1)
    accounts.sign_in(studio, EMAIL, PASSWORD)
    with studio.database.read() as session:
        assert session.query(SignIn).count() == 1


def test_the_database_holds_no_password_and_no_token(
    studio: Studio, ada: accounts.Experimenter
) -> None:
    token = accounts.create_api_token(studio, ada, "tests")
    with studio.database.read() as session:
        assert session.query(Account).one().password_hash.startswith("$argon2id$")
        assert session.query(ApiToken).one().token_hash == secret_hash(token) != token
