"""Sealed addresses of recordings."""

from __future__ import annotations

import re
from itertools import product
from types import SimpleNamespace
from typing import Any, cast

import pytest

from app.services.recordings.addresses import AddressedRecording, VideoAddresses, is_of_session
from app.services.server_secret import ServerSecret
from app.storage.models.studies import SessionRow


def addresses(key: bytes = b"k" * 32) -> VideoAddresses:
    return VideoAddresses(cast(ServerSecret, SimpleNamespace(key=lambda _purpose: key)))


def session(row_id: int = 7, seed: int = 2**48 - 1) -> SessionRow:
    return cast(SessionRow, SimpleNamespace(id=row_id, seed=seed))


def test_an_address_opens_to_what_was_sealed_and_is_the_same_each_time() -> None:
    made = addresses().of(session(), 3, (0, 1))
    assert addresses().of(session(), 3, (0, 1)) == made
    assert re.fullmatch(r"[A-Za-z0-9_-]{46}", made)
    shown = addresses().opened(made)
    assert shown == AddressedRecording(7, 2**48 - 1, 3)
    assert is_of_session(shown, 2**48 - 1)
    assert not is_of_session(shown, 1)


def test_no_two_places_sessions_or_recordings_share_an_address() -> None:
    places: Any = product((1, 2), (5, 6), (1, 2, 3), ((-3, 0), (0, 0), (0, 1), (1, 0)))
    made = [addresses().of(session(row, seed), clip, at) for row, seed, clip, at in places]
    assert len(set(made)) == len(made) == 48
    # Nothing of them is alike: no common beginning, as a number in plain would leave.
    assert len({address[:4] for address in made}) == 48


@pytest.mark.parametrize("place", [0, 5, 22, 44])
def test_an_address_that_was_changed_anywhere_opens_to_nothing(place: int) -> None:
    made = addresses().of(session(), 3, (0, 1))
    other = "A" if made[place] != "A" else "B"
    assert addresses().opened(made[:place] + other + made[place + 1 :]) is None
    assert addresses(b"x" * 32).opened(made) is None


@pytest.mark.parametrize("name", ["", "nothing", "a" * 46, "é" * 46, "=" * 46, "a" * 4000])
def test_what_was_never_sealed_opens_to_nothing(name: str) -> None:
    assert addresses().opened(name) is None
