"""`pbpo demo`: what the first start sets up, and the second one finds."""

from __future__ import annotations

import json
import socket
import stat
import sys
from pathlib import Path

import httpx
import pytest

from app import cli

from .served import Served
from .test_experimenter_pages import form_token

#: What a shell calls a command that Ctrl+C ended.
INTERRUPTED = 130


def access_of(data_dir: Path) -> dict[str, str]:
    path = data_dir / "access.json"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    access: dict[str, str] = json.loads(path.read_text())
    assert list(access) == [
        "participant_url",
        "experimenter_url",
        "email",
        "password",
        "api_token",
        "study",
    ]
    return access


def signs_in(access: dict[str, str], url: str) -> None:
    with httpx.Client(base_url=url) as browser:
        page = browser.get("/sign-in")
        given = {name: access[name] for name in ("email", "password")}
        answer = browser.post("/sign-in", data={**given, "csrf_token": form_token(page)})
        assert answer.headers["location"] == "/studies"
        assert "waste-crane" in browser.get("/studies").text
    headers = {"Authorization": f"Bearer {access['api_token']}"}
    table = httpx.get(f"{url}/api/v1/studies/waste-crane/export/sessions.csv", headers=headers)
    assert table.status_code == 200
    assert "Before you take part" in httpx.get(access["participant_url"]).text


@pytest.mark.long
def test_a_second_start_reuses_what_the_first_one_set_up(tmp_path: Path, media_dir: Path) -> None:
    data_dir = tmp_path / "data"
    with Served("demo", data_dir, media_dir) as first:
        access = access_of(data_dir)
        assert access["participant_url"] == f"{first.url}/s/waste-crane"
        assert access["experimenter_url"] == f"{first.url}/studies"
        for told in ("participant_url", "experimenter_url", "email", "password"):
            assert access[told] in first.output
        live = f"{first.url}/s/waste-crane-live"
        assert live in first.output
        assert "Before you take part" in httpx.get(live).text
        signs_in(access, first.url)
        assert first.interrupt() == INTERRUPTED
        assert "Traceback" not in first.output

    with Served("demo", data_dir, media_dir) as second:
        again = access_of(data_dir)
        for kept in ("email", "password", "api_token", "study"):
            assert again[kept] == access[kept]
        assert again["participant_url"] == f"{second.url}/s/waste-crane"
        signs_in(again, second.url)
        second.kill()


@pytest.mark.parametrize("command", ["demo", "serve"])
def test_a_port_that_is_taken_is_said_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = ["pbpo", command, "--port", str(port), "--data-dir", str(tmp_path / "data")]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as left:
            cli.main()
    said = capsys.readouterr()
    assert left.value.code == 2
    assert said.out == ""
    assert said.err.startswith(f"pbpo: expected a free port, and 127.0.0.1:{port} cannot be had")
    assert len(said.err.splitlines()) == 1
    assert not (tmp_path / "data").exists()
