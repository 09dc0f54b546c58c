"""Who runs studies: accounts, sign-ins, and API tokens."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from enum import StrEnum
from functools import cache
from typing import TypeVar

from argon2 import PasswordHasher
from argon2.exceptions import VerificationError
from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from app.services.context import AppContext
from app.services.runtime.errors import ConflictError, NotFoundError, SignInRequiredError
from app.services.runtime.ids import new_secret, secret_hash
from app.storage.models.accounts import Account, ApiToken, SignIn

from . import audit_log, credential_revocation, login_rate_limit, password_hash_limit

SIGN_IN_LASTS = timedelta(days=14)
API_TOKEN_LASTS = timedelta(days=365)

#: A password that people choose: NIST SP 800-63B asks for length, not for kinds of characters.
MIN_PASSWORD_LENGTH = 10

#: One @ with something on both sides, and nothing that a line of a table could not hold.
_ADDRESS = re.compile(r"[^@\s\x00-\x1f]+@[^@\s\x00-\x1f]+")
LONGEST_ADDRESS = 254

Token = TypeVar("Token", SignIn, ApiToken)

_hasher = PasswordHasher()


class Role(StrEnum):
    """What an account is for; `access` says what each may do."""

    ADMIN = "admin"
    EXPERIMENTER = "experimenter"
    REVIEWER = "reviewer"


class Scope(StrEnum):
    """What an API token may do: look and export, platforms' ids as well, or all its account may."""

    READ = "read"
    IDENTITIES = "identities"
    WRITE = "write"


@dataclass(frozen=True)
class Principal:
    """Somebody who is signed in, or whose API token was given."""

    account_id: int
    email: str
    role: Role
    scope: Scope = Scope.WRITE
    # Which of the account's sign-ins it is; None for an API token. Somebody is the same in both.
    sign_in_id: int | None = field(default=None, compare=False)


def create(
    app: AppContext,
    email: str,
    password: str,
    role: Role | None = None,
    actor: str = audit_log.COMMAND_LINE,
) -> Principal:
    """A new account; the first is an admin's unless said otherwise, the others experimenters'.

    Raises ConflictError if the address has an account or the password is too short.
    """
    email = address(email)
    hashed = hashed_password(password)
    with app.database.write() as db:
        if role is None:
            is_first = not db.scalar(select(func.count(Account.id)))
            role = Role.ADMIN if is_first else Role.EXPERIMENTER
        account = add(db, app.now(), email, hashed, role)
        audit_log.note(db, app.now(), actor, "account made", account=email, role=role.value)
        return _experimenter(account)


def add(db: Session, at: datetime, email: str, hashed: str, role: Role) -> Account:
    """A new account within a transaction. Raises ConflictError if the address has one."""
    if by_address(db, email) is not None:
        raise ConflictError(f"expected a new address, and {email!r} has an account")
    account = Account(email=email, password_hash=hashed, role=role.value, created_at=at)
    db.add(account)
    db.flush()
    return account


def set_password(
    app: AppContext, email: str, password: str, actor: str = audit_log.COMMAND_LINE
) -> None:
    """Give an account another password; every sign-in, API token and open link of it ends."""
    hashed = hashed_password(password)
    with app.database.write() as db:
        account = require(db, email)
        account.password_hash = hashed
        ended = credential_revocation.end_all(db, account).noted()
        audit_log.note(db, app.now(), actor, "password reset", account=account.email, **ended)


def find(app: AppContext, email: str) -> Principal:
    with app.database.read() as db:
        return _experimenter(require(db, email))


def sign_in(
    app: AppContext,
    email: str,
    password: str,
    came_from: login_rate_limit.CameFrom = login_rate_limit.ANYWHERE,
) -> str:
    """Check a password: a token for the browser.

    Raises SignInRequiredError, never saying why; TooManyTriesError, whoever's address it is; or
    TooManyPasswordsError, having looked at nothing.
    """
    email = normal(email)
    with password_hash_limit.one_at_a_time(app, came_from):
        with app.database.write() as db:
            # Counted before the password is looked at: trying many at once gains nothing.
            login_rate_limit.spend(db, app.now(), email, came_from)
            account = by_address(db, email)
        is_right = is_password_of(account, password)
    if account is None or account.disabled_at is not None or not is_right:
        _note_failure(app, email, came_from, is_known=account is not None)
        raise SignInRequiredError("that address and password do not belong together")
    token = new_secret()
    with app.database.write() as db:
        now = app.now()
        still = held(db, account.id)
        if still.password_hash != account.password_hash or still.disabled_at is not None:
            # Changed while this password was looked at: that change ended every sign-in.
            raise SignInRequiredError("that address and password do not belong together")
        login_rate_limit.forgive(db, email, came_from)
        db.execute(delete(SignIn).where(SignIn.expires_at < now))
        db.add(
            SignIn(
                account_id=account.id,
                token_hash=secret_hash(token),
                created_at=now,
                expires_at=now + SIGN_IN_LASTS,
            )
        )
        audit_log.note(db, now, email, "signed in")
    return token


def _note_failure(
    app: AppContext, email: str, came_from: login_rate_limit.CameFrom, *, is_known: bool
) -> None:
    with app.database.write() as db:
        now = app.now()
        # Something is written for either: an answer must not take longer where there is an account.
        login_rate_limit.was_wrong(db, now, email, came_from)
        if is_known:
            # Of an address that nobody has, nothing is kept: it may be anybody's, and strangers
            # could fill the trail, which nothing empties.
            audit_log.note(db, now, audit_log.NOBODY, "sign-in failed", account=email)


def sign_out(app: AppContext, token: str) -> None:
    with app.database.write() as db:
        row = db.scalar(select(SignIn).where(SignIn.token_hash == secret_hash(token)))
        if row is not None:
            audit_log.note(db, app.now(), row.account.email, "signed out")
            db.delete(row)


def create_api_token(
    app: AppContext,
    experimenter: Principal,
    label: str,
    scope: Scope = Scope.WRITE,
    lasts: timedelta = API_TOKEN_LASTS,
    actor: str = audit_log.COMMAND_LINE,
) -> str:
    """A token for programs, shown this once.

    Raises SignInRequiredError if the sign-in that asks for it has ended meanwhile.
    """
    token = new_secret()
    with app.database.write() as db:
        now = app.now()
        held(db, experimenter.account_id)
        asking = experimenter.sign_in_id
        if asking is not None and db.get(SignIn, asking) is None:
            raise SignInRequiredError("expected a sign-in that is in force, and it has ended")
        db.add(
            ApiToken(
                account_id=experimenter.account_id,
                label=label,
                scope=scope.value,
                token_hash=secret_hash(token),
                created_at=now,
                expires_at=now + lasts,
            )
        )
        told = {"account": experimenter.email, "label": label, "scope": scope.value}
        audit_log.note(db, now, actor, "API token made", **told)
    return token


def by_sign_in(app: AppContext, token: str) -> Principal:
    """Who is signed in with this token. Raises SignInRequiredError."""
    return _by_token(app, SignIn, token)


def by_api_token(app: AppContext, token: str) -> Principal:
    """Whose API token this is. Raises SignInRequiredError."""
    return _by_token(app, ApiToken, token)


def _by_token(app: AppContext, table: type[Token], token: str) -> Principal:
    with app.database.read() as db:
        statement = select(table).where(table.token_hash == secret_hash(token))
        row: Token | None = db.scalar(statement)
        if row is None or app.now() >= row.expires_at:
            raise SignInRequiredError("expected a token that is in force, got another")
        if row.account.disabled_at is not None:
            raise SignInRequiredError("this account is closed")
        if isinstance(row, ApiToken):
            return _experimenter(row.account, Scope(row.scope))
        return _experimenter(row.account, sign_in_id=row.id)


def _experimenter(
    account: Account, scope: Scope = Scope.WRITE, sign_in_id: int | None = None
) -> Principal:
    return Principal(account.id, account.email, Role(account.role), scope, sign_in_id)


def by_address(db: Session, email: str) -> Account | None:
    return db.scalar(select(Account).where(Account.email == normal(email)))


def held(db: Session, account_id: int) -> Account:
    """The account of this id as it is now, held for this transaction."""
    return db.scalars(select(Account).where(Account.id == account_id).with_for_update()).one()


def require(db: Session, email: str) -> Account:
    """The account of this address. Raises NotFoundError."""
    account = by_address(db, email)
    if account is None:
        raise NotFoundError(f"there is no account of {normal(email)!r}")
    return account


def is_password_of(account: Account | None, password: str) -> bool:
    """Whether the password is this account's; takes as long where there is no account."""
    hashed = _nobodys_hash() if account is None else account.password_hash
    try:
        return _hasher.verify(hashed, password)
    except VerificationError:
        return False


@cache
def _nobodys_hash() -> str:
    """Verified where there is no account, so that an answer takes as long as where there is."""
    return _hasher.hash("nobody has this password")


def hashed_password(password: str) -> str:
    """The hash of a password that somebody chose. Raises ConflictError if it is too short."""
    if len(password) < MIN_PASSWORD_LENGTH:
        raise ConflictError(
            f"expected a password of at least {MIN_PASSWORD_LENGTH} characters, got {len(password)}"
        )
    return _hasher.hash(password)


def normal(email: str) -> str:
    return email.strip().lower()


def address(email: str) -> str:
    """The address as it is kept. Raises ConflictError if it is none."""
    email = normal(email)
    if not _ADDRESS.fullmatch(email) or len(email) > LONGEST_ADDRESS:
        raise ConflictError(f"expected an e-mail address, got {email[:LONGEST_ADDRESS]!r}")
    return email
