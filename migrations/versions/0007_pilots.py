"""Pilot sessions, and the link by which a study lets people into one

Revision: 0007, after 0006.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

BEFORE = "mode IN ('live', 'preview', 'simulated')"
AFTER = "mode IN ('live', 'preview', 'pilot', 'simulated')"


def upgrade() -> None:
    _allow(AFTER)
    # Not as a batch, which copies the table and would forget that its ids never come again.
    op.add_column("studies", sa.Column("pilot_link_hash", sa.String(length=64), nullable=True))
    op.create_index(op.f("ix_studies_pilot_link_hash"), "studies", ["pilot_link_hash"], unique=True)


def downgrade() -> None:
    op.drop_index(op.f("ix_studies_pilot_link_hash"), "studies")
    op.drop_column("studies", "pilot_link_hash")
    _allow(BEFORE)


def _allow(modes: str) -> None:
    with op.batch_alter_table("sessions") as batch:
        batch.drop_constraint(op.f("ck_sessions_mode"), type_="check")
        batch.create_check_constraint(op.f("ck_sessions_mode"), modes)
