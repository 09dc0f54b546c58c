"""Addresses of recordings, encrypted for one position in one session.

An address holds the session, the position in it and the recording, encrypted and authenticated by
AES-SIV (RFC 5297) under a key of the server. The encryption is deterministic: the same position of
the same session always has the same address, so that prefetched videos are found in the browser's
cache. The same recording has a different address in any other session and at any other position.
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

#: Session id, session seed (16 + 32 bits), recording id, and the two numbers of a position.
_FORM = struct.Struct(">IHIIhh")
_SEED_BITS = 48
#: Length of the AES-SIV tag in bytes.
_TAG = 16
_LETTERS = -(-(_FORM.size + _TAG) * 8 // 6)

#: First numbers of positions outside trials. Trials have their index, and the practice has -1.
DEVICE_CHECK = -2
FAMILIARISATION = -3

#: A position in a session: trial and query index, or one of the above and a number.
Place = tuple[int, int]


@dataclass(frozen=True)
class AddressedRecording:
    """The decrypted content of an address.

    seed: of the session, 48 bits. It tells the session from a later one with the same id.
    """

    session_id: int
    seed: int
    recording_id: int


class VideoAddresses:
    """Encrypts and decrypts addresses with a key derived from the server's secret."""

    def __init__(self, secret: ServerSecret) -> None:
        self._secret = secret

    def of(self, session: SessionRow, recording_id: int, place: Place) -> str:
        """The address of this recording at this position of the session."""
        seed = session.seed % 2**_SEED_BITS
        plain = _FORM.pack(session.id or 0, seed >> 32, seed % 2**32, recording_id, *place)
        sealed = self._cipher.encrypt(plain, None)
        return base64.urlsafe_b64encode(sealed).decode().rstrip("=")

    def opened(self, name: str) -> AddressedRecording | None:
        """The content of an address; None if it was not made with this server's key."""
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
    """Whether the address was made for the session with this seed."""
    own: int = seed % 2**_SEED_BITS
    return shown.seed == own
