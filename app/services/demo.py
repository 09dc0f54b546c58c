"""The demo: the shipped study, open, with an account made for this data folder alone."""

from __future__ import annotations

import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path

from . import account_list, accounts, audit, studies
from .errors import NotFoundError, SignInRequiredError
from .studio import Studio

STUDY = "waste-crane"
EMAIL = "demo@pbpo.example"
ACCESS_FILE = "access.json"


@dataclass(frozen=True)
class Access:
    """How to get into the demo; kept in `access.json`, which only its owner may read."""

    participant_url: str
    experimenter_url: str
    email: str
    password: str
    api_token: str
    study: str


def prepare(studio: Studio, base_url: str) -> Access:
    """Set up what is missing, and write `access.json`. A second start reuses what is there."""
    try:
        study = studies.find(studio, STUDY)
    except NotFoundError:
        study = studies.create(studio, studies.load_folder(STUDY))
    if study.status == studies.DRAFT:
        studies.open_study(studio, STUDY)

    path = studio.settings.data_dir / ACCESS_FILE
    kept = _read(path)
    password = kept.get("password") or secrets.token_urlsafe(12)
    try:
        experimenter = accounts.find(studio, EMAIL)
        account_list.enable(studio, EMAIL, audit.COMMAND_LINE)
        if not kept.get("password"):
            accounts.set_password(studio, EMAIL, password)
    except NotFoundError:
        experimenter = accounts.create(studio, EMAIL, password, accounts.Role.ADMIN)
    token = kept.get("api_token", "")
    try:
        accounts.by_api_token(studio, token)
    except SignInRequiredError:
        token = accounts.create_api_token(studio, experimenter, "demo")
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
