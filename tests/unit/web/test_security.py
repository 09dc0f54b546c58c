"""Who is asking, read from a header."""

from __future__ import annotations

import pytest

from app.web.experimenter.sign_in_pages import _own_path
from app.web.http.security import bearer


@pytest.mark.parametrize(
    ("header", "token"),
    [
        ("Bearer abc", "abc"),
        ("bearer  abc ", "abc"),
        ("Bearer", None),
        ("Bearer  ", None),
        ("Basic abc", None),
        ("abc", None),
        ("", None),
        (None, None),
    ],
)
def test_only_a_bearer_token_is_a_token(header: str | None, token: str | None) -> None:
    assert bearer(header) == token


@pytest.mark.parametrize(
    ("path", "followed"),
    [
        ("/studies/short?mode=all", "/studies/short?mode=all"),
        ("//evil.example", "/studies"),
        ("/\\evil.example", "/studies"),
        ("https://evil.example", "/studies"),
        ("studies", "/studies"),
        ("", "/studies"),
    ],
)
def test_only_a_path_of_our_own_is_followed(path: str, followed: str) -> None:
    assert _own_path(path) == followed
