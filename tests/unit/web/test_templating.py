"""Small things that pages are made with."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from jinja2 import UndefinedError

from app.web.http import templating


def test_a_time_says_in_utc_what_it_is() -> None:
    tokyo = timezone(timedelta(hours=9))
    moment = datetime(2026, 3, 1, 9, 5, 7, tzinfo=tokyo)
    expected = '<time datetime="2026-03-01T00:05:07Z">2026-03-01 00:05 UTC</time>'
    assert templating.local_time(moment) == expected
    assert templating.local_time(None) == "–"


def test_a_static_files_address_changes_with_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(templating, "STATIC", tmp_path)
    file = tmp_path / "a.css"
    file.write_text("a {}")
    before = templating.static_url("a.css")
    assert before.startswith("/static/a.css?v=")
    assert templating.static_url("a.css") == before
    file.write_text("b {}")
    later = datetime.now(UTC).timestamp() + 5
    import os

    os.utime(file, (later, later))
    assert templating.static_url("a.css") != before


def test_a_page_with_something_missing_fails_instead_of_showing_a_gap() -> None:
    with pytest.raises(UndefinedError):
        templating.environment.from_string("{{ nothing }}").render()


def test_what_people_wrote_is_escaped() -> None:
    page = templating.environment.from_string("{{ title }}").render(title="<b>&")
    assert page == "&lt;b&gt;&amp;"
