"""The demo: the shipped study, opened, with an account and token of this data folder."""

from __future__ import annotations

import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path

from app.services.accounts import accounts, administration, audit_log
from app.services.context import AppContext
from app.services.runtime.errors import NotFoundError, SignInRequiredError

from . import repository

STUDY = "waste-crane"
#: Opened beside it: its videos are recorded by the crane inside the server while people choose.
LIVE_STUDY = "waste-crane-live"
EMAIL = "demo@pbpo.example"
ACCESS_FILE = "access.json"


@dataclass(frozen=True)
class Access:
    """The addresses and credentials of the demo, as stored in `access.json` (mode 0600)."""

    participant_url: str
    experimenter_url: str
    email: str
    password: str
    api_token: str
    study: str


def prepare(app: AppContext, base_url: str) -> Access:
    """Create what is missing and write `access.json`. A second start reuses what exists."""
    for slug in (STUDY, LIVE_STUDY):
        try:
            study = repository.find(app, slug)
        except NotFoundError:
            study = repository.create(app, repository.load_folder(slug))
        if study.status == repository.DRAFT:
            repository.open_study(app, slug)

    path = app.settings.data_dir / ACCESS_FILE
    kept = _read(path)
    password = kept.get("password") or secrets.token_urlsafe(12)
    try:
        experimenter = accounts.find(app, EMAIL)
        administration.enable(app, EMAIL, audit_log.COMMAND_LINE)
        if not kept.get("password"):
            accounts.set_password(app, EMAIL, password)
    except NotFoundError:
        experimenter = accounts.create(app, EMAIL, password, accounts.Role.ADMIN)
    token = kept.get("api_token", "")
    try:
        accounts.by_api_token(app, token)
    except SignInRequiredError:
        token = accounts.create_api_token(app, experimenter, "demo")
    access = Access(
        participant_url=f"{base_url}/s/{STUDY}",
        experimenter_url=f"{base_url}/studies",
        email=EMAIL,
        password=password,
        api_token=token,
        study=STUDY,
    )
    _write(path, access)
    return access


def _read(path: Path) -> dict[str, str]:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    pairs = kept.items() if isinstance(kept, dict) else ()
    return {key: value for key, value in pairs if isinstance(value, str)}


def _write(path: Path, access: Access) -> None:
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(asdict(access), file, indent=2)
        file.write("\n")
    part.replace(path)
