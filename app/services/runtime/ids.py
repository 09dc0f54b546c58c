"""Random names and secrets. A secret is shown once; what is kept is its hash."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import string

#: No vowels and no look-alikes: no words by accident, no doubt when read aloud.
_ALPHABET = "23456789BCDFGHJKLMNPQRSTVWXZ"

#: What `new_secret` makes: 32 bytes in base64.
_SECRET = re.compile(r"[A-Za-z0-9_-]{43}")

_LETTERS_AND_DIGITS = string.ascii_letters + string.digits

#: 62^22 is over 2^130.
_PUBLIC_ID_LETTERS = 22

#: Enough that guessing is hopeless without a limit on tries: 28^16 is over 2^76.
_RECEIPT_LETTERS = 16


def new_secret() -> str:
    """256 random bits, safe in a URL and in a header."""
    return secrets.token_urlsafe(32)


def secret_hash(secret: str) -> str:
    """SHA-256 in hex. The secrets are random, so a slow hash would add nothing."""
    return hashlib.sha256(secret.encode()).hexdigest()


def form_token(key: bytes, purpose: str, browser: str, sent: str) -> str:
    """The token that a form leads to: HMAC-SHA256 of what it sent and of the browser's own secret.

    The same form sent twice by one browser, before the first answer has brought it its cookie, so
    leads to one session. key: the server's; without it nobody computes the token from what the form
    sent, and without the browser's secret the server computes another one.
    """
    said = f"{purpose}:{browser}:{sent}"
    return hmac.new(key, said.encode(), hashlib.sha256).hexdigest()


def is_secret(value: str) -> bool:
    """Whether this may be a `new_secret()`: anything shorter could be thought of by two people."""
    return _SECRET.fullmatch(value) is not None


def new_public_id() -> str:
    """131 random bits: an address that can be given away and not guessed.

    Letters and digits alone: one that began with a dash would look like a formula in an export.
    """
    # One number rather than 22: a study has thousands of recordings.
    number = secrets.randbelow(len(_LETTERS_AND_DIGITS) ** _PUBLIC_ID_LETTERS)
    return _spelt(number, _LETTERS_AND_DIGITS, _PUBLIC_ID_LETTERS)


def _spelt(number: int, alphabet: str, length: int) -> str:
    """The last so many digits of a number whose digits are these letters, the last one first."""
    letters = ""
    for _ in range(length):
        number, place = divmod(number, len(alphabet))
        letters += alphabet[place]
    return letters


def receipt_code(token: str) -> str:
    """The code that goes with a session's token, such as `7KQ2-MXRD-9FWT-4BHC`: 76 bits.

    It is worked out from the token, so that every page of the session can show it again although
    nobody keeps it: of the code, as of the token, only a hash is stored.
    """
    number = int.from_bytes(hashlib.sha256(f"receipt:{token}".encode()).digest(), "big")
    letters = _spelt(number, _ALPHABET, _RECEIPT_LETTERS)
    return "-".join(letters[start : start + 4] for start in range(0, _RECEIPT_LETTERS, 4))


def receipt_hash(code: str) -> str:
    """Hash of a receipt's code, however a person has typed it: spaces, hyphens, small letters."""
    return secret_hash("".join(filter(str.isalnum, code.upper())))


def new_pseudonym(prefix: str) -> str:
    """A name such as `P-7KQ2-MXRD`, 38 random bits, to be read and typed by people."""
    letters = "".join(secrets.choice(_ALPHABET) for _ in range(8))
    return f"{prefix}-{letters[:4]}-{letters[4:]}"


def new_seed() -> int:
    """48 random bits: exact in JSON, in R and in every spreadsheet."""
    return secrets.randbits(48)
