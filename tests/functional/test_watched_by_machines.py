"""What machines ask a server, and what it writes into its log."""

from __future__ import annotations

import io
import json
import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from pydantic import SecretStr, ValidationError
from sqlalchemy import text

from app.services.context import AppContext
from app.services.runtime import json_logging
from app.services.runtime.metrics import SHARED_DIR
from app.services.runtime.settings import Settings, settings_faults
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api
from .conftest import Recruit

ROOT = Path(__file__).parents[2]
TOKEN = "a-token-of-thirty-two-characters!"


@pytest.fixture
def settings(tmp_path: Path, media_dir: Path) -> Settings:
    return Settings(
        data_dir=tmp_path / "data",
        # A folder that a test may take away.
        media_dir=tmp_path / "media",
        metrics_token=SecretStr(TOKEN),
    )


@pytest.fixture
def lines() -> Iterator[io.StringIO]:
    """What is logged as JSON meanwhile."""
    stream = io.StringIO()
    root = logging.getLogger()
    before, level = root.handlers[:], root.level
    json_logging.write_json(stream)
    yield stream
    root.handlers[:] = before
    root.setLevel(level)


def read(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def metric(client: Api, name: str) -> float:
    answer = client.get("/metrics", headers={"Authorization": f"Bearer {TOKEN}"})
    assert answer.status_code == 200
    found = [line for line in answer.text.splitlines() if line.startswith(f"{name} ")]
    return float(found[0].rpartition(" ")[2]) if found else 0.0


def faults(client: Api) -> list[str]:
    answer = client.get("/readyz")
    body = answer.json()
    assert answer.status_code == (503 if body["faults"] else 200)
    assert body["ready"] == (not body["faults"])
    found: list[str] = body["faults"]
    return found


def test_a_server_that_can_work_says_so(client: Api) -> None:
    assert client.get("/healthz").json() == {"alive": True}
    assert faults(client) == []
    # As watchmen ask that want no body.
    assert client.request("HEAD", "/healthz").status_code == 200
    assert client.request("HEAD", "/readyz").status_code == 200


def test_a_database_at_another_schema_is_said(client: Api, app: AppContext) -> None:
    with app.database.write() as db:
        db.execute(text("UPDATE alembic_version SET version_num = '0001'"))
    assert [fault.partition(",")[0] for fault in faults(client)] == [
        "The database is at schema 0001"
    ]
    assert client.get("/healthz").status_code == 200


@pytest.mark.sqlite
def test_a_database_that_is_none_is_said_without_its_address(client: Api, app: AppContext) -> None:
    app.database.close()
    for file in app.settings.data_dir.glob("pbpo.sqlite3*"):
        file.unlink()
    (app.settings.data_dir / "pbpo.sqlite3").write_bytes(b"no database at all" * 100)
    assert faults(client) == ["The database cannot be reached."]


def test_a_media_folder_that_has_gone_is_said(client: Api, app: AppContext) -> None:
    app.settings.media_dir.rmdir()
    assert faults(client) == [
        "The folder of rendered videos cannot be written to: No such file or directory."
    ]
    app.settings.media_dir.mkdir()
    assert faults(client) == []


def test_measurements_are_for_the_holder_of_their_token(client: Api) -> None:
    for headers in ({}, {"Authorization": "Bearer "}, {"Authorization": f"Bearer {TOKEN}x"}):
        assert client.get("/metrics", headers=headers).status_code == 401
    assert metric(client, "pbpo_fit_seconds_count") == 0


def test_without_a_token_in_the_settings_there_are_no_measurements(
    client: Api, app: AppContext, application: FastAPI
) -> None:
    open_to_nobody = app.settings.model_copy(update={"metrics_token": None})
    object.__setattr__(app, "settings", open_to_nobody)
    for headers in ({}, {"Authorization": "Bearer "}, {"Authorization": "Bearer None"}):
        assert client.get("/metrics", headers=headers).status_code == 404


def test_a_short_token_is_refused_and_not_repeated() -> None:
    with pytest.raises(ValidationError) as refused:
        Settings(metrics_token=SecretStr("short-secret"))
    said = settings_faults(refused.value)
    assert "PBPO_METRICS_TOKEN" in said
    assert "32" in said
    assert "short-secret" not in said


def test_responses_their_wait_and_the_sessions_are_counted(
    client: Api, short_study: StudyInfo, clock: Clock
) -> None:
    session = client.start().to_first_query()
    clock.forward(5)
    first = session.state["query"]["id"]
    session.respond("left")
    session.respond("left")
    refused = session.call("responses", {"query_id": first, "response": "right"})
    assert refused.status_code == 409

    assert metric(client, 'pbpo_responses_total{response="left"}') == 2
    assert metric(client, 'pbpo_responses_total{response="right"}') == 0
    assert metric(client, "pbpo_response_to_next_query_seconds_count") == 2
    # Nothing was worked out ahead: this studio's background does nothing.
    assert metric(client, 'pbpo_steps_asked_total{worked_out="at once"}') == 2
    assert metric(client, "pbpo_fit_seconds_count") == 3
    assert metric(client, 'pbpo_sessions{mode="live",stage="query"}') == 1


def test_a_process_goes_on_measuring_when_its_folder_has_gone(tmp_path: Path) -> None:
    """As workers do that finish what is under way, after the process that made it was killed."""
    code = """
import os, shutil
from app.services.runtime.metrics import SHARED_DIR, Metrics
metrics = Metrics()
shutil.rmtree(os.environ[SHARED_DIR])
metrics.step_asked(ahead=True)
metrics.renders(1, 0)
metrics.request("GET", "/", 200, 0.1)
with metrics.answering("left"), metrics.fitting(1):
    pass
"""
    folder = tmp_path / "shared"
    folder.mkdir()
    environment = {**os.environ, SHARED_DIR: str(folder)}
    subprocess.run([sys.executable, "-c", code], env=environment, cwd=ROOT, check=True)


def test_measurements_name_patterns_and_nobody(client: Api, short_study: StudyInfo) -> None:
    client.get("/invitations/a-secret-of-somebodys")
    client.get("/nothing/here?PROLIFIC_PID=5f0000000000000000000001")
    client.request("BREW", "/coffee")
    text = client.get("/metrics", headers={"Authorization": f"Bearer {TOKEN}"}).text
    assert 'route="/invitations/{token}"' in text
    assert 'method="other"' in text
    for secret in ("a-secret", "nothing/here", "5f00", "BREW", "coffee"):
        assert secret not in text


def test_a_request_has_an_id_that_its_lines_share(client: Api, lines: io.StringIO) -> None:
    given = "proxy-0123456789"
    assert client.get("/", headers={"X-Request-ID": given}).headers["X-Request-ID"] == given
    made = client.get("/").headers["X-Request-ID"]
    assert len(made) == 16
    ids = [line["request_id"] for line in read(lines) if line["message"] == "request"]
    assert ids == [given, made]


@pytest.mark.parametrize("given", ["short", "x" * 65, 'a"}{"b":"cdefgh', "a b c d e f g h"])
def test_an_id_that_is_not_sane_is_replaced(client: Api, given: str) -> None:
    assert client.get("/healthz", headers={"X-Request-ID": given}).headers["X-Request-ID"] != given


def test_a_line_tells_what_happened_and_to_nobody(
    client: Api, recruit: Recruit, lines: io.StringIO
) -> None:
    recruit("recruitment: {platform: prolific, codes: {completed: C0MPLETE}}\n")
    person = "5f0000000000000000000001"
    query = f"PROLIFIC_PID={person}&STUDY_ID=s&SESSION_ID=t"
    assert client.get(f"/s/short?{query}", headers={"User-Agent": "Odd/1.0"}).status_code == 200
    client.post("/sign-in", data={"email": "eve@lab.example", "password": "hunter2hunter2"})
    client.get("/invitations/a-secret-of-somebodys")
    told = read(lines)
    found = [line for line in told if line["message"] == "request"]
    assert [line["route"] for line in found] == ["/s/{slug}", "/sign-in", "/invitations/{token}"]
    assert set(found[0]) == {
        *("message", "method", "route", "status", "ms"),
        *("request_id", "level", "logger", "timestamp"),
    }
    for secret in (person, "PROLIFIC", "Odd", "eve@", "hunter2", "a-secret", "127.0.0.1"):
        assert secret not in lines.getvalue()


def test_a_line_names_the_whole_pattern_of_its_route(client: Api, lines: io.StringIO) -> None:
    client.get("/api/v1/session")
    client.get("/studies/short/ethics")
    client.get("/nowhere")
    named = [line["route"] for line in read(lines) if line["message"] == "request"]
    assert named == ["/api/v1/session", "/studies/{slug}/ethics", "none"]


def test_machines_that_ask_all_day_leave_no_lines_until_something_is_wrong(
    client: Api, app: AppContext, lines: io.StringIO
) -> None:
    client.get("/healthz")
    client.get("/readyz")
    assert read(lines) == []
    app.settings.media_dir.rmdir()
    client.get("/readyz")
    assert [(line["route"], line["status"]) for line in read(lines)] == [("/readyz", 503)]


def test_what_other_code_logs_is_json_too_with_its_traceback(lines: io.StringIO) -> None:
    try:
        raise ValueError("a fault")
    except ValueError:
        logging.getLogger("app.services.maintenance.retention").exception("the sweep failed")
    (line,) = read(lines)
    assert (line["message"], line["level"]) == ("the sweep failed", "error")
    assert "ValueError: a fault" in line["exception"]


def test_the_dashboard_asks_for_what_is_measured(client: Api, short_study: StudyInfo) -> None:
    """Each name in the example dashboard is one that the server gives."""
    client.start().to_first_query().respond("left")
    text = client.get("/metrics", headers={"Authorization": f"Bearer {TOKEN}"}).text
    names = names_on_the_dashboard()
    assert len(names) >= 8
    # Only with workers apart is there a number of them.
    assert names - set(words(text)) == {"pbpo_workers"}


def names_on_the_dashboard() -> set[str]:
    folder = Path(__file__).parents[2] / "deploy" / "grafana"
    dashboard = json.loads((folder / "pbpo-studio.json").read_text(encoding="utf-8"))
    asked = " ".join(target["expr"] for panel in dashboard["panels"] for target in panel["targets"])
    return {word for word in words(asked) if word.startswith("pbpo_")}


def words(expression: str) -> list[str]:
    return "".join(c if c.isalnum() or c == "_" else " " for c in expression).split()
