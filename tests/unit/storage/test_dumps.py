"""How PostgreSQL's own programs are told where a database is."""

from __future__ import annotations

import pytest
from psycopg.conninfo import conninfo_to_dict

from app.storage import dump_restore

URL = "postgresql+psycopg://ada:s%3Acret@db.lab.example:5433/studies"
SAFE = "sslmode=verify-full&sslrootcert=/a b.pem&sslcert=/c&sslkey=/k&channel_binding=require"
LOCAL = "postgresql+psycopg://ada:s%3Acret@/studies"


@pytest.mark.parametrize(
    ("url", "place"),
    [
        (URL, {}),
        (
            f"{URL}?{SAFE}",
            {
                "sslmode": "verify-full",
                "sslrootcert": "/a b.pem",
                "sslcert": "/c",
                "sslkey": "/k",
                "channel_binding": "require",
            },
        ),
        (
            f"{LOCAL}?host=one:5433&host=two:5434",
            {"host": "one,two", "port": "5433,5434"},
        ),
        (
            f"{LOCAL}?host=/run/postgresql&port=5433&options=-c%20search_path%3Dstudies",
            {"host": "/run/postgresql", "options": "-c search_path=studies"},
        ),
        (f"{URL}?sslpassword=s%3Acret", {}),
    ],
)
def test_they_get_all_that_the_url_says_and_no_password_in_their_words(
    url: str, place: dict[str, str]
) -> None:
    words, password = dump_restore.reached(url)
    common = {"user": "ada", "dbname": "studies", "host": "db.lab.example", "port": "5433"}
    assert conninfo_to_dict(words) == {**common, **place}
    assert password == "s:cret"
    assert "cret" not in words
