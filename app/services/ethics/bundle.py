"""The ethics bundle: everything that a board asks for, as files of one zip, alike each time."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import select

from app import __version__
from app.pbbo import ENGINE_VERSION
from app.services import sharing
from app.services.studies import StudyInfo, stored_plan
from app.services.studio import Studio
from app.storage.tables import PlanVersion
from app.study import texts

from . import fields

#: The texts of a study in the order in which people read them.
ORDER = ("welcome", "consent", "instructions", "debrief")


@dataclass(frozen=True)
class Text:
    """One text of one language: consent has a version that each agreement names."""

    plan_version: int
    language: str
    name: str
    sha256: str
    consent_version: str | None
    markdown: str


@dataclass(frozen=True)
class Version:
    """One version of the plan and its texts."""

    number: int
    plan_hash: str
    created_at: datetime


def versions(studio: Studio, study: StudyInfo) -> list[Version]:
    """Every version, the first first."""
    return [Version(row.version, row.plan_hash, row.created_at) for row in _versions(studio, study)]


def texts_of(studio: Studio, study: StudyInfo) -> list[Text]:
    """Every text of every version, in every language."""
    return [
        Text(
            row.version,
            language,
            name,
            hashlib.sha256(markdown.encode()).hexdigest(),
            texts.consent_version(markdown) if name == "consent" else None,
            markdown,
        )
        for row in _versions(studio, study)
        for language in stored_plan(row).languages
        for name, markdown in sorted(row.texts[language].items(), key=_place)
    ]


def documents(studio: Studio, study: StudyInfo) -> dict[str, bytes]:
    """The files of the bundle but for the screens, by name."""
    found = {
        f"texts/version-{text.plan_version}/{text.language}/{text.name}.md": text.markdown.encode()
        for text in texts_of(studio, study)
    }
    found["stored_fields.csv"] = fields.as_csv(fields.fields(study.plan))
    found["plan.json"] = _json(study.plan.model_dump(mode="json"))
    found["versions.json"] = _json(_versions_said(studio, study))
    return found


def zipped(files: Mapping[str, bytes]) -> bytes:
    """One zip of these files: the same files give the same bytes."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name])
    return sink.getvalue()


def _versions_said(studio: Studio, study: StudyInfo) -> dict[str, object]:
    return {
        "study": study.slug,
        "program": f"PBPO Studio {__version__}",
        "method": f"preference optimiser {ENGINE_VERSION}",
        "versions": [
            {
                "version": version.number,
                "plan_hash": version.plan_hash,
                "made_at": version.created_at.isoformat(timespec="seconds"),
            }
            for version in versions(studio, study)
        ],
        "texts": [
            {
                "version": text.plan_version,
                "language": text.language,
                "text": text.name,
                "sha256": text.sha256,
                "consent_version": text.consent_version,
            }
            for text in texts_of(studio, study)
        ],
        "who_has_access": [
            {"account": tie.email, "as": "owner" if tie.is_owner else "shared with"}
            for tie in sharing.ties(studio, study.slug)
        ],
    }


def _versions(studio: Studio, study: StudyInfo) -> list[PlanVersion]:
    statement = (
        select(PlanVersion).where(PlanVersion.study_id == study.id).order_by(PlanVersion.version)
    )
    with studio.database.read() as session:
        return list(session.scalars(statement))


def _place(named: tuple[str, str]) -> tuple[int, str]:
    name = named[0]
    return (ORDER.index(name) if name in ORDER else len(ORDER), name)


def _json(value: object) -> bytes:
    return (json.dumps(value, indent=2, ensure_ascii=False, sort_keys=True) + "\n").encode()
