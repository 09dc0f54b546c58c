"""Addresses of recordings, sealed for one place in one session.

An address holds the session, the place in it and the recording, encrypted and authenticated by
AES-SIV (RFC 5297) under a key of the server's. The encryption is deterministic: the same place of
the same session has the same address each time, so that a browser finds again what it has fetched
ahead. The same recording has another address in any other session, and at any other place.
"""

from __future__ import annotations

import base64
import struct
from binascii import Error as NotBase64
from dataclasses import dataclass
from functools import cached_property

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV

from app.services.server_secret import ServerSecret
from app.storage.models.studies import SessionRow

#: Session, its seed (48 bits), recording, and the two numbers of a place.
_FORM = struct.Struct(">IHIIhh")
_SEED_BITS = 48
#: What AES-SIV adds, in bytes.
_TAG = 16
_LETTERS = -(-(_FORM.size + _TAG) * 8 // 6)

#: First numbers of places that are in no trial; those of trials count from -1, the practice.
DEVICE_CHECK = -2
FAMILIARISATION = -3

#: Where in a session a recording is shown: a trial and a query, or one of the above and a number.
Place = tuple[int, int]


@dataclass(frozen=True)
class AddressedRecording:
    """What an address stands for. seed: of the session; another one may have its id by now."""

    session_id: int
    seed: int
    recording_id: int


class VideoAddresses:
    """Seals addresses, and opens those that it has sealed."""

    def __init__(self, secret: ServerSecret) -> None:
        self._secret = secret

    def of(self, session: SessionRow, recording_id: int, place: Place) -> str:
        """The name under which a session finds this recording at this place."""
        seed = session.seed % 2**_SEED_BITS
        plain = _FORM.pack(session.id or 0, seed >> 32, seed % 2**32, recording_id, *place)
        sealed = self._cipher.encrypt(plain, None)
        return base64.urlsafe_b64encode(sealed).decode().rstrip("=")

    def opened(self, name: str) -> AddressedRecording | None:
        """What a name stands for; None if this server has not sealed it."""
        if len(name) != _LETTERS:
            return None
        try:
            sealed = base64.b64decode(name + "=" * (-len(name) % 4), b"-_", validate=True)
            plain = self._cipher.decrypt(sealed, None)
        except (NotBase64, ValueError, InvalidTag):
            return None
        session_id, high, low, recording_id, _, _ = _FORM.unpack(plain)
        return AddressedRecording(session_id, (high << 32) + low, recording_id)

    @cached_property
    def _cipher(self) -> AESSIV:
        return AESSIV(self._secret.key("video addresses"))


def is_of_session(shown: AddressedRecording, seed: int) -> bool:
    """Whether the address was sealed for the session that has this seed."""
    own: int = seed % 2**_SEED_BITS
    return shown.seed == own
