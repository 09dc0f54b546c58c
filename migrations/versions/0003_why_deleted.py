"""Tombstones tell a deletion at the person's wish from one by the study's retention rule

Revision: 0003, after 0002.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("tombstones") as batch:
        # Before there were retention rules, every deletion was at the person's wish.
        batch.add_column(
            sa.Column("reason", sa.String(length=10), nullable=False, server_default="wish")
        )
        batch.create_check_constraint(
            op.f("ck_tombstones_reason"), "reason IN ('wish', 'retention')"
        )
    with op.batch_alter_table("tombstones") as batch:
        batch.alter_column("reason", server_default=None)


def downgrade() -> None:
    with op.batch_alter_table("tombstones") as batch:
        batch.drop_constraint(op.f("ck_tombstones_reason"), type_="check")
        batch.drop_column("reason")
