"""Accounts, sign-ins and API tokens of the people who run studies.

Passwords are hashed with Argon2; of every token only a hash is stored.
"""

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

#: Minimum length in characters. NIST SP 800-63B asks for length, not for kinds of characters.
MIN_PASSWORD_LENGTH = 10

#: One @ with text on both sides, and no white space or control characters.
_ADDRESS = re.compile(r"[^@\s\x00-\x1f]+@[^@\s\x00-\x1f]+")
LONGEST_ADDRESS = 254

Token = TypeVar("Token", SignIn, ApiToken)

_hasher = PasswordHasher()


class Role(StrEnum):
    """The role of an account. `studies.access` maps roles to rights."""

    ADMIN = "admin"
    EXPERIMENTER = "experimenter"
    REVIEWER = "reviewer"


class Scope(StrEnum):
    """What an API token permits: reading and exporting, platform ids, or everything."""

    READ = "read"
    IDENTITIES = "identities"
    WRITE = "write"


@dataclass(frozen=True)
class Principal:
    """An authenticated caller: the account, with the sign-in or API token that was used.

    sign_in_id: the sign-in that was used; None for an API token. It does not count in comparisons.
    """

    account_id: int
    email: str
    role: Role
    scope: Scope = Scope.WRITE
    sign_in_id: int | None = field(default=None, compare=False)


def create(
    app: AppContext,
    email: str,
    password: str,
    role: Role | None = None,
    actor: str = audit_log.COMMAND_LINE,
) -> Principal:
    """Create an account and return its principal.

    role: None makes the first account an admin and all later ones experimenters. actor: who is
    named in the audit log. Raises ConflictError if the address has an account or the password is
    too short.
    """
    email = address(email)
    hashed = hashed_password(password)
    with app.database.write() as db:
        if role is None:
            is_first = not db.scalar(select(func.count(Account.id)))
            role = Role.ADMIN if is_first else Role.EXPERIMENTER
        account = add(db, app.now(), email, hashed, role)
        audit_log.note(db, app.now(), actor, "account made", account=email, role=role.value)
        return _principal(account)


def add(db: Session, at: datetime, email: str, hashed: str, role: Role) -> Account:
    """Insert an account within the transaction of `db`.

    Raises ConflictError if the address has one.
    """
    if by_address(db, email) is not None:
        raise ConflictError(f"expected a new address, and {email!r} has an account")
    account = Account(email=email, password_hash=hashed, role=role.value, created_at=at)
    db.add(account)
    db.flush()
    return account


def set_password(
    app: AppContext, email: str, password: str, actor: str = audit_log.COMMAND_LINE
) -> None:
    """Replace the password of an account and revoke its sign-ins, API tokens and unused links.

    Raises NotFoundError if no account has the address, and ConflictError if the password is too
    short.
    """
    hashed = hashed_password(password)
    with app.database.write() as db:
        account = require(db, email)
        account.password_hash = hashed
        ended = credential_revocation.revoke_all(db, account).as_details()
        audit_log.note(db, app.now(), actor, "password reset", account=account.email, **ended)


def find(app: AppContext, email: str) -> Principal:
    """The principal of the account with this address. Raises NotFoundError."""
    with app.database.read() as db:
        return _principal(require(db, email))


def sign_in(
    app: AppContext,
    email: str,
    password: str,
    came_from: login_rate_limit.CameFrom = login_rate_limit.ANYWHERE,
) -> str:
    """Check a password, store a sign-in and return its token for the browser's cookie.

    came_from: where the attempt comes from, for the rate limits. Raises SignInRequiredError with
    the same message for every cause; TooManyTriesError, whether or not the address has an account;
    or TooManyPasswordsError if the queue for password hashing is full, before anything was checked.
    """
    email = normal(email)
    with password_hash_limit.hash_slot(app, came_from):
        with app.database.write() as db:
            # Counted before the password is verified, so that parallel attempts are limited too.
            login_rate_limit.record_attempt(db, app.now(), email, came_from)
            account = by_address(db, email)
        is_right = is_password_of(account, password)
    if account is None or account.disabled_at is not None or not is_right:
        _note_failure(app, email, came_from, is_known=account is not None)
        raise SignInRequiredError("that address and password do not belong together")
    token = new_secret()
    with app.database.write() as db:
        now = app.now()
        still = lock(db, account.id)
        if still.password_hash != account.password_hash or still.disabled_at is not None:
            # The account changed while this password was verified, which revoked every sign-in.
            raise SignInRequiredError("that address and password do not belong together")
        login_rate_limit.reset(db, email, came_from)
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
        # One row is written in both cases, so that the response time does not reveal an account.
        login_rate_limit.record_failure(db, now, email, came_from)
        if is_known:
            # Attempts for an unknown address are not logged: it may be anyone's address, and the
            # audit log is never pruned, so strangers could fill it.
            audit_log.note(db, now, audit_log.NOT_SIGNED_IN, "sign-in failed", account=email)


def sign_out(app: AppContext, token: str) -> None:
    """Delete the sign-in of this token, if there is one."""
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
    """Create an API token for the account and return it. Only its hash is stored.

    lasts: its lifetime. Raises SignInRequiredError if the sign-in of `experimenter` has ended
    meanwhile.
    """
    token = new_secret()
    with app.database.write() as db:
        now = app.now()
        lock(db, experimenter.account_id)
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
        details = {"account": experimenter.email, "label": label, "scope": scope.value}
        audit_log.note(db, now, actor, "API token made", **details)
    return token


def by_sign_in(app: AppContext, token: str) -> Principal:
    """The principal of a sign-in's token. Raises SignInRequiredError."""
    return _by_token(app, SignIn, token)


def by_api_token(app: AppContext, token: str) -> Principal:
    """The principal of an API token. Raises SignInRequiredError."""
    return _by_token(app, ApiToken, token)


def by_credential_hash(app: AppContext, hashed: str) -> Principal:
    """The principal of the API token or sign-in with this hash. Raises SignInRequiredError."""
    try:
        return _by_token_hash(app, ApiToken, hashed)
    except SignInRequiredError:
        return _by_token_hash(app, SignIn, hashed)


def _by_token(app: AppContext, table: type[Token], token: str) -> Principal:
    return _by_token_hash(app, table, secret_hash(token))


def _by_token_hash(app: AppContext, table: type[Token], hashed: str) -> Principal:
    with app.database.read() as db:
        statement = select(table).where(table.token_hash == hashed)
        row: Token | None = db.scalar(statement)
        if row is None or app.now() >= row.expires_at:
            raise SignInRequiredError("expected a token that is in force, got another")
        if row.account.disabled_at is not None:
            raise SignInRequiredError("this account is closed")
        if isinstance(row, ApiToken):
            return _principal(row.account, Scope(row.scope))
        return _principal(row.account, sign_in_id=row.id)


def _principal(
    account: Account, scope: Scope = Scope.WRITE, sign_in_id: int | None = None
) -> Principal:
    return Principal(account.id, account.email, Role(account.role), scope, sign_in_id)


def by_address(db: Session, email: str) -> Account | None:
    """The account with this address, or None."""
    return db.scalar(select(Account).where(Account.email == normal(email)))


def lock(db: Session, account_id: int) -> Account:
    """Read the current row of this account and lock it until the transaction ends."""
    return db.scalars(select(Account).where(Account.id == account_id).with_for_update()).one()


def require(db: Session, email: str) -> Account:
    """The account with this address. Raises NotFoundError."""
    account = by_address(db, email)
    if account is None:
        raise NotFoundError(f"there is no account of {normal(email)!r}")
    return account


def is_password_of(account: Account | None, password: str) -> bool:
    """Whether the password is this account's. Takes as long for None, which no password matches."""
    hashed = _dummy_hash() if account is None else account.password_hash
    try:
        return _hasher.verify(hashed, password)
    except VerificationError:
        return False


@cache
def _dummy_hash() -> str:
    """A hash to verify against when there is no account, so that the response takes as long."""
    return _hasher.hash("nobody has this password")


def hashed_password(password: str) -> str:
    """The Argon2 hash of a new password. Raises ConflictError if the password is too short."""
    if len(password) < MIN_PASSWORD_LENGTH:
        raise ConflictError(
            f"expected a password of at least {MIN_PASSWORD_LENGTH} characters, got {len(password)}"
        )
    return _hasher.hash(password)


def normal(email: str) -> str:
    """The address without surrounding white space, in lower case, as it is stored."""
    return email.strip().lower()


def address(email: str) -> str:
    """Normalise and check an address. Raises ConflictError if it is not an e-mail address."""
    email = normal(email)
    if not _ADDRESS.fullmatch(email) or len(email) > LONGEST_ADDRESS:
        raise ConflictError(f"expected an e-mail address, got {email[:LONGEST_ADDRESS]!r}")
    return email
