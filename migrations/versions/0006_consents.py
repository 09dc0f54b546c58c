"""Each agreement with its time, the plan that each answer was given under, and a count of decliners

Revision: 0006, after 0005.
"""

from __future__ import annotations

import hashlib
import json
import unicodedata
from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "consents",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("plan_id", sa.Integer(), nullable=False),
        sa.Column("consent_version", sa.String(length=12), nullable=False),
        sa.Column("agreed_at", sa.DateTime(timezone=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["session_id"],
            ["sessions.id"],
            name=op.f("fk_consents_session_id_sessions"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["plan_id"], ["plans.id"], name=op.f("fk_consents_plan_id_plans"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_consents")),
        sa.UniqueConstraint("session_id", "plan_id", name=op.f("uq_consents_session_id_plan_id")),
    )
    op.create_table(
        "declined_counts",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("day", sa.DateTime(timezone=True), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.CheckConstraint("number > 0", name=op.f("ck_declined_counts_number")),
        sa.ForeignKeyConstraint(
            ["study_id"],
            ["studies.id"],
            name=op.f("fk_declined_counts_study_id_studies"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_declined_counts")),
        sa.UniqueConstraint("study_id", "day", name=op.f("uq_declined_counts_study_id_day")),
    )
    with op.batch_alter_table("responses") as batch:
        batch.add_column(sa.Column("plan_id", sa.Integer(), nullable=True))
        batch.create_foreign_key(
            op.f("fk_responses_plan_id_plans"), "plans", ["plan_id"], ["id"], ondelete="CASCADE"
        )
    _keep_what_is_known()


def downgrade() -> None:
    with op.batch_alter_table("responses") as batch:
        batch.drop_constraint(op.f("fk_responses_plan_id_plans"), type_="foreignkey")
        batch.drop_column("plan_id")
    op.drop_table("declined_counts")
    op.drop_table("consents")


def _keep_what_is_known() -> None:
    connection = op.get_bind()
    connection.execute(
        sa.text(
            "INSERT INTO consents (session_id, plan_id, consent_version, agreed_at)"
            " SELECT id, plan_id, consent_version, consented_at FROM sessions"
            " WHERE consent_version IS NOT NULL"
        )
    )
    connection.execute(
        sa.text(
            "UPDATE responses SET plan_id = (SELECT sessions.plan_id FROM queries"
            " JOIN trials ON trials.id = queries.trial_id"
            " JOIN sessions ON sessions.id = trials.session_id"
            " WHERE queries.id = responses.query_id)"
        )
    )
    renewals: dict[int, list[str]] = {}
    for session_id, former in connection.execute(
        sa.text(
            "SELECT session_id, value FROM events WHERE event = 'consent_renewed'"
            " AND value IS NOT NULL ORDER BY id"
        )
    ):
        renewals.setdefault(session_id, []).append(former)
    for session_id, formers in renewals.items():
        _keep_former(connection, session_id, formers)


def _keep_former(connection: sa.Connection, session_id: int, formers: Sequence[str]) -> None:
    """Renewed consents had left the former version in an event, and its time nowhere.

    Answers before the last agreement were given under the former one. Where there were several,
    nobody can say under which, and it stays unknown.
    """
    row = connection.execute(
        sa.text(
            "SELECT study_id, plan_id, language, started_at, consented_at FROM sessions"
            " WHERE id = :id"
        ),
        {"id": session_id},
    ).one()
    plans = connection.execute(
        sa.text(
            "SELECT id, texts, created_at FROM plans WHERE study_id = :study AND id <> :newest"
            " ORDER BY version"
        ),
        {"study": row.study_id, "newest": row.plan_id},
    ).all()
    known: dict[str, int] = {}
    for plan_id, texts, created_at in plans:
        version = _consent_version(texts, row.language)
        # Of several versions with one consent: the newest when the session began.
        if version is not None and (version not in known or created_at <= row.started_at):
            known[version] = plan_id
    for plan_id, version in {known[f]: f for f in formers if f in known}.items():
        connection.execute(
            sa.text(
                "INSERT INTO consents (session_id, plan_id, consent_version, agreed_at)"
                " VALUES (:session, :plan, :version, NULL)"
            ),
            {"session": session_id, "plan": plan_id, "version": version},
        )
    before = known.get(formers[0]) if len(formers) == 1 else None
    connection.execute(
        sa.text(
            "UPDATE responses SET plan_id = :plan WHERE answered_at < :renewed AND query_id IN"
            " (SELECT queries.id FROM queries JOIN trials ON trials.id = queries.trial_id"
            " WHERE trials.session_id = :session)"
        ),
        {"plan": before, "renewed": row.consented_at, "session": session_id},
    )


def _consent_version(texts: Any, language: str) -> str | None:
    """As `app.study.texts.consent_version` was when this was written."""
    found = json.loads(texts) if isinstance(texts, str) else texts
    written = found.get(language) if isinstance(found, Mapping) else None
    markdown = written.get("consent") if isinstance(written, Mapping) else None
    if markdown is None:
        return None
    lines = unicodedata.normalize("NFC", markdown).splitlines()
    normalised = "\n".join(line.rstrip() for line in lines).strip()
    return hashlib.sha256(normalised.encode("utf-8")).hexdigest()[:12]
