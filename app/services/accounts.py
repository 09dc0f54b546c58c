"""Who runs studies: accounts, sign-ins, and API tokens."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from enum import StrEnum
from functools import cache
from typing import TypeVar

from argon2 import PasswordHasher
from argon2.exceptions import VerificationError
from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from app.storage.accounts import Account, ApiToken, SignIn

from .errors import ConflictError, NotFoundError, SignInRequiredError
from .studio import Studio
from .tokens import new_secret, secret_hash

SIGN_IN_LASTS = timedelta(days=14)
API_TOKEN_LASTS = timedelta(days=365)

#: A password that people choose: NIST SP 800-63B asks for length, not for kinds of characters.
MIN_PASSWORD_LENGTH = 10

Token = TypeVar("Token", SignIn, ApiToken)

_hasher = PasswordHasher()


class Role(StrEnum):
    """What an account is for; `access` says what each may do."""

    ADMIN = "admin"
    EXPERIMENTER = "experimenter"
    REVIEWER = "reviewer"


class Scope(StrEnum):
    """What an API token may do: look and export, or all that its account may."""

    READ = "read"
    WRITE = "write"


@dataclass(frozen=True)
class Experimenter:
    """Somebody who is signed in, or whose API token was given."""

    account_id: int
    email: str
    role: Role
    scope: Scope = Scope.WRITE


def create(studio: Studio, email: str, password: str, role: Role | None = None) -> Experimenter:
    """A new account; the first is an admin's unless said otherwise, the others experimenters'.

    Raises ConflictError if the address has an account or the password is too short.
    """
    email = _normal(email)
    if "@" not in email.strip("@"):
        raise ConflictError(f"expected an e-mail address, got {email!r}")
    hashed = _hash(password)
    with studio.database.write() as session:
        if _account(session, email) is not None:
            raise ConflictError(f"expected a new address, and {email!r} has an account")
        if role is None:
            is_first = not session.scalar(select(func.count(Account.id)))
            role = Role.ADMIN if is_first else Role.EXPERIMENTER
        account = Account(
            email=email, password_hash=hashed, role=role.value, created_at=studio.now()
        )
        session.add(account)
        session.flush()
        return _experimenter(account)


def set_password(studio: Studio, email: str, password: str) -> None:
    """Give an account another password; every browser that is signed in is signed out."""
    hashed = _hash(password)
    with studio.database.write() as session:
        account = _account(session, _normal(email))
        if account is None:
            raise NotFoundError(f"there is no account of {email!r}")
        account.password_hash = hashed
        session.execute(delete(SignIn).where(SignIn.account_id == account.id))


def find(studio: Studio, email: str) -> Experimenter:
    with studio.database.read() as session:
        account = _account(session, _normal(email))
    if account is None:
        raise NotFoundError(f"there is no account of {email!r}")
    return _experimenter(account)


def sign_in(studio: Studio, email: str, password: str) -> str:
    """Check a password: a token for the browser. Raises SignInRequiredError, never saying why."""
    with studio.database.read() as session:
        account = _account(session, _normal(email))
    try:
        _hasher.verify(_nobodys_hash() if account is None else account.password_hash, password)
    except VerificationError:
        account = None
    if account is None or account.disabled_at is not None:
        raise SignInRequiredError("that address and password do not belong together")
    token = new_secret()
    with studio.database.write() as session:
        now = studio.now()
        session.execute(delete(SignIn).where(SignIn.expires_at < now))
        session.add(
            SignIn(
                account_id=account.id,
                token_hash=secret_hash(token),
                created_at=now,
                expires_at=now + SIGN_IN_LASTS,
            )
        )
    return token


def sign_out(studio: Studio, token: str) -> None:
    with studio.database.write() as session:
        session.execute(delete(SignIn).where(SignIn.token_hash == secret_hash(token)))


def create_api_token(
    studio: Studio,
    experimenter: Experimenter,
    label: str,
    scope: Scope = Scope.WRITE,
    lasts: timedelta = API_TOKEN_LASTS,
) -> str:
    """A token for programs, shown this once."""
    token = new_secret()
    with studio.database.write() as session:
        now = studio.now()
        session.add(
            ApiToken(
                account_id=experimenter.account_id,
                label=label,
                scope=scope.value,
                token_hash=secret_hash(token),
                created_at=now,
                expires_at=now + lasts,
            )
        )
    return token


def by_sign_in(studio: Studio, token: str) -> Experimenter:
    """Who is signed in with this token. Raises SignInRequiredError."""
    return _by_token(studio, SignIn, token)


def by_api_token(studio: Studio, token: str) -> Experimenter:
    """Whose API token this is. Raises SignInRequiredError."""
    return _by_token(studio, ApiToken, token)


def _by_token(studio: Studio, table: type[Token], token: str) -> Experimenter:
    with studio.database.read() as session:
        statement = select(table).where(table.token_hash == secret_hash(token))
        row: Token | None = session.scalar(statement)
        if row is None or studio.now() >= row.expires_at:
            raise SignInRequiredError("expected a token that is in force, got another")
        if row.account.disabled_at is not None:
            raise SignInRequiredError("this account is closed")
        scope = Scope(row.scope) if isinstance(row, ApiToken) else Scope.WRITE
        return _experimenter(row.account, scope)


def _experimenter(account: Account, scope: Scope = Scope.WRITE) -> Experimenter:
    return Experimenter(account.id, account.email, Role(account.role), scope)


def _account(session: Session, email: str) -> Account | None:
    return session.scalar(select(Account).where(Account.email == email))


@cache
def _nobodys_hash() -> str:
    """Verified where there is no account, so that an answer takes as long as where there is."""
    return _hasher.hash("nobody has this password")


def _hash(password: str) -> str:
    if len(password) < MIN_PASSWORD_LENGTH:
        raise ConflictError(
            f"expected a password of at least {MIN_PASSWORD_LENGTH} characters, got {len(password)}"
        )
    return _hasher.hash(password)


def _normal(email: str) -> str:
    return email.strip().lower()
