"""Random names and secrets. A secret is shown once; what is kept is its hash."""

from __future__ import annotations

import hashlib
import secrets

#: No vowels and no look-alikes: no words by accident, no doubt when read aloud.
_ALPHABET = "23456789BCDFGHJKLMNPQRSTVWXZ"


def new_secret() -> str:
    """256 random bits, safe in a URL and in a header."""
    return secrets.token_urlsafe(32)


def secret_hash(secret: str) -> str:
    """SHA-256 in hex. The secrets are random, so a slow hash would add nothing."""
    return hashlib.sha256(secret.encode()).hexdigest()


def new_public_id() -> str:
    """128 random bits: an address that can be given away and not guessed."""
    return secrets.token_urlsafe(16)


def new_pseudonym(prefix: str) -> str:
    """A name such as `P-7KQ2-MXRD`, 38 random bits, to be read and typed by people."""
    letters = "".join(secrets.choice(_ALPHABET) for _ in range(8))
    return f"{prefix}-{letters[:4]}-{letters[4:]}"


def new_seed() -> int:
    """48 random bits: exact in JSON, in R and in every spreadsheet."""
    return secrets.randbits(48)
