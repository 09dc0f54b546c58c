"""Random ids, secrets, pseudonyms and seeds. A secret is shown once; only its hash is stored."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import string

#: Without vowels, which could form words, and without characters that look alike.
_ALPHABET = "23456789BCDFGHJKLMNPQRSTVWXZ"

#: Format of `new_secret`: 32 bytes in URL-safe base64.
_SECRET = re.compile(r"[A-Za-z0-9_-]{43}")

_LETTERS_AND_DIGITS = string.ascii_letters + string.digits

#: 62^22 is over 2^130.
_PUBLIC_ID_LETTERS = 22

#: 28^16 is over 2^76: too many to guess even without a rate limit.
_RECEIPT_LETTERS = 16


def new_secret() -> str:
    """256 random bits, safe in a URL and in a header."""
    return secrets.token_urlsafe(32)


def secret_hash(secret: str) -> str:
    """SHA-256 in hex. The secrets are random, so a slow hash would add nothing."""
    return hashlib.sha256(secret.encode()).hexdigest()


def form_token(key: bytes, purpose: str, browser: str, sent: str) -> str:
    """The session token for a submitted form: HMAC-SHA256 of its content and the browser's secret.

    A form that one browser submits twice, before the first response sets its cookie, thereby leads
    to one session. key: the server's key, without which the token cannot be computed from the form.
    browser: the browser's secret. sent: the content of the form.
    """
    said = f"{purpose}:{browser}:{sent}"
    return hmac.new(key, said.encode(), hashlib.sha256).hexdigest()


def is_secret(value: str) -> bool:
    """Whether the value has the format of `new_secret()`; shorter values could be guessed."""
    return _SECRET.fullmatch(value) is not None


def new_public_id() -> str:
    """131 random bits as letters and digits: an id that can be published but not guessed.

    There is no dash, which at the start of a cell would look like a formula in an export.
    """
    # One random number instead of 22, because a study has thousands of recordings.
    number = secrets.randbelow(len(_LETTERS_AND_DIGITS) ** _PUBLIC_ID_LETTERS)
    return _spelt(number, _LETTERS_AND_DIGITS, _PUBLIC_ID_LETTERS)


def _spelt(number: int, alphabet: str, length: int) -> str:
    """The last `length` digits of a number in the base of this alphabet, the last digit first."""
    letters = ""
    for _ in range(length):
        number, place = divmod(number, len(alphabet))
        letters += alphabet[place]
    return letters


def receipt_code(token: str) -> str:
    """The receipt code of a session's token, such as `7KQ2-MXRD-9FWT-4BHC`: 76 bits.

    It is derived from the token, so that every page of the session can show it although only hashes
    of the token and of the code are stored.
    """
    number = int.from_bytes(hashlib.sha256(f"receipt:{token}".encode()).digest(), "big")
    letters = _spelt(number, _ALPHABET, _RECEIPT_LETTERS)
    return "-".join(letters[start : start + 4] for start in range(0, _RECEIPT_LETTERS, 4))


def receipt_hash(code: str) -> str:
    """Hash of a receipt code, ignoring case, spaces and hyphens."""
    return secret_hash("".join(filter(str.isalnum, code.upper())))


def new_pseudonym(prefix: str) -> str:
    """A pseudonym such as `P-7KQ2-MXRD`, 38 random bits, easy to read and type."""
    letters = "".join(secrets.choice(_ALPHABET) for _ in range(8))
    return f"{prefix}-{letters[:4]}-{letters[4:]}"


def new_seed() -> int:
    """48 random bits, so that JSON, R and spreadsheets represent the seed exactly."""
    return secrets.randbits(48)
