"""Random names and secrets."""

from __future__ import annotations

import re

from app.services.runtime.ids import new_pseudonym, new_public_id, new_secret, new_seed, secret_hash


def test_names_are_of_the_form_that_others_rely_on() -> None:
    assert re.fullmatch(r"S-[2-9B-DF-HJ-NP-TV-XZ]{4}-[2-9B-DF-HJ-NP-TV-XZ]{4}", new_pseudonym("S"))
    assert re.fullmatch(r"[A-Za-z0-9_-]{43}", new_secret())
    assert re.fullmatch(r"[A-Za-z0-9]{22}", new_public_id())
    assert 0 <= new_seed() < 2**48


def test_nothing_comes_twice() -> None:
    for make in (new_secret, new_public_id, new_seed, lambda: new_pseudonym("P")):
        assert len({make() for _ in range(200)}) == 200


def test_a_name_holds_no_word_and_no_look_alike() -> None:
    letters = set("".join(new_pseudonym("")[1:] for _ in range(500)))
    assert letters.isdisjoint("AEIOUY01")


def test_a_secret_cannot_be_read_from_its_hash() -> None:
    secret = new_secret()
    assert secret_hash(secret) == secret_hash(secret)
    assert secret not in secret_hash(secret)
    assert len(secret_hash(secret)) == 64
