"""Verifies links signed by Prolific.

Prolific adds `prolific_token`, a JWT signed by RS256 with one of its published keys. Its claim
`prolific` has the parameters of the link, and `aud` the address of the study.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

import jwt

#: The parameter of the address that carries the token.
PARAMETER = "prolific_token"
#: Who signs.
ISSUER = "https://www.prolific.com"
_ALGORITHM = "RS256"
_MOST_CHARACTERS = 6_000


class SignatureError(ValueError):
    """The token does not prove that Prolific sent its bearer to this study."""


def key_id(token: str) -> str:
    """The id of the published key that signed the token. Raises SignatureError."""
    if not token or len(token) > _MOST_CHARACTERS:
        raise SignatureError("expected a link that Prolific signed, and its token is missing")
    try:
        header = jwt.get_unverified_header(token)
    except jwt.PyJWTError as error:
        raise SignatureError(f"expected a token of Prolific's form: {error}") from error
    found = header.get("kid")
    if header.get("alg") != _ALGORITHM or not isinstance(found, str):
        raise SignatureError(f"expected a token signed by {_ALGORITHM} with a named key")
    return found


def verified(token: str, key: jwt.PyJWK, address: str, leeway_s: float = 0) -> dict[str, str]:
    """The parameters of the link as Prolific signed them, for this address of ours.

    leeway_s: how long the token is accepted after its expiry. Raises SignatureError.
    """
    try:
        claims: Mapping[str, Any] = jwt.decode(
            token,
            key,
            algorithms=[_ALGORITHM],
            issuer=ISSUER,
            leeway=leeway_s,
            options={"require": ["exp", "iss", "aud"], "verify_aud": False},
        )
    except jwt.PyJWTError as error:
        raise SignatureError(f"expected a token that Prolific signed: {error}") from error
    audience = claims["aud"]
    audiences = audience if isinstance(audience, list) else [audience]
    if not any(_is_of(one, address) for one in audiences):
        raise SignatureError("expected a token for this address, got one for another")
    said = claims.get("prolific")
    if not isinstance(said, dict):
        raise SignatureError("expected the claim `prolific` with the parameters of the link")
    return {key: value for key, value in said.items() if isinstance(value, str)}


def _is_of(audience: object, address: str) -> bool:
    """Whether the audience is our host, or the study's address on it."""
    if not isinstance(audience, str):
        return False
    meant, own = urlsplit(audience if "//" in audience else f"//{audience}"), urlsplit(address)
    same_page = meant.path.rstrip("/") in ("", own.path)
    return bool(own.netloc) and meant.netloc.lower() == own.netloc.lower() and same_page
