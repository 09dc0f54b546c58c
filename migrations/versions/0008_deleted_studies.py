"""What is left of a deleted study, and a scope of API tokens for identities

Revision: 0008, after 0007.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

_SCOPES = ("'read', 'write'", "'read', 'identities', 'write'")


def upgrade() -> None:
    op.create_table(
        "deleted_studies",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("slug", sa.String(length=60), nullable=False),
        sa.Column("way_back", sa.JSON(), nullable=True),
        sa.Column("deleted_on", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deleted_studies")),
        sa.UniqueConstraint("slug", name=op.f("uq_deleted_studies_slug")),
    )
    op.create_table(
        "deleted_sessions",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("deleted_study_id", sa.Integer(), nullable=False),
        sa.Column("token_key", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(
            ["deleted_study_id"],
            ["deleted_studies.id"],
            name=op.f("fk_deleted_sessions_deleted_study_id_deleted_studies"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deleted_sessions")),
        sa.UniqueConstraint("token_key", name=op.f("uq_deleted_sessions_token_key")),
    )
    op.create_index(
        op.f("ix_deleted_sessions_deleted_study_id"), "deleted_sessions", ["deleted_study_id"]
    )
    _scopes(*_SCOPES, 5, 10)


def downgrade() -> None:
    op.execute("UPDATE api_tokens SET scope = 'read' WHERE scope = 'identities'")
    _scopes(*reversed(_SCOPES), 10, 5)
    op.drop_table("deleted_sessions")
    op.drop_table("deleted_studies")


def _scopes(_before: str, after: str, length: int, new_length: int) -> None:
    with op.batch_alter_table("api_tokens") as batch:
        batch.drop_constraint(op.f("ck_api_tokens_scope"), type_="check")
        batch.alter_column(
            "scope",
            existing_type=sa.String(length=length),
            type_=sa.String(length=new_length),
            existing_nullable=False,
        )
        batch.create_check_constraint(op.f("ck_api_tokens_scope"), f"scope IN ({after})")
