"""Identities take a scope of their own, and what is written to the disk is for its owner."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.services import export
from app.services.accounts import accounts
from app.services.accounts.accounts import Scope
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.runtime.settings import Settings
from app.services.studies import repository
from tests.conftest import FROM_PROLIFIC, Idle

from .client import Api
from .conftest import EMAIL, PASSWORD, Recruit

EXPORTS = "/api/v1/studies/short"


@pytest.mark.parametrize(
    ("scope", "identities"), [(Scope.READ, 403), (Scope.IDENTITIES, 200), (Scope.WRITE, 200)]
)
def test_a_token_that_may_read_sees_no_identities(
    client: Api, app: AppContext, recruit: Recruit, scope: Scope, identities: int
) -> None:
    recruit(FROM_PROLIFIC)
    account = accounts.create(app, EMAIL, PASSWORD)
    token = accounts.create_api_token(app, account, "tests", scope)
    headers = {"Authorization": f"Bearer {token}"}
    client.start(external_ids={"PROLIFIC_PID": "5f0c1ada"})
    asked = client.get(f"{EXPORTS}/export/identities.csv", headers=headers)
    assert asked.status_code == identities
    assert ("5f0c1ada" in asked.text) == (identities == 200)
    for other in ("export/sessions.csv", "export.zip", "report.html"):
        answer = client.get(f"{EXPORTS}/{other}", headers=headers)
        assert answer.status_code == 200
        assert b"5f0c1ada" not in answer.content
    changed = client.post("/studies/short/pause", headers=headers, data={"csrf_token": "0"})
    assert changed.status_code == 403


@pytest.fixture
def open_umask() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_exports_are_for_their_owner_whatever_the_umask_says(
    app: AppContext, recruit: Recruit, tmp_path: Path, open_umask: None
) -> None:
    recruit(FROM_PROLIFIC)
    there = tmp_path / "there"
    there.mkdir(mode=0o755)
    request = export.Request(repository.find(app, "short"))
    files = list(export.find("psych-ds").files(request))
    for folder in (tmp_path / "new" / "folder", there):
        written = export.write_folder(app, EMAIL, request, "psych-ds", files, folder)
        assert {mode(path) for path in written} == {0o600}
        assert mode(folder / "data") == 0o700
    assert mode(tmp_path / "new") == 0o700
    # One that was there already is its maker's.
    assert mode(there) == 0o755
    again = export.write_folder(app, EMAIL, request, "psych-ds", files, there)
    assert {mode(path) for path in again} == {0o600}


@pytest.mark.sqlite
def test_the_databases_file_is_for_its_owner(tmp_path: Path, open_umask: None) -> None:
    settings = Settings(data_dir=tmp_path / "data", media_dir=tmp_path / "media")
    open_app(settings, background=Idle(1)).close()
    made = {path.name: mode(path) for path in settings.data_dir.iterdir() if path.is_file()}
    assert made
    assert set(made.values()) == {0o600}
