"""In which order the pages of a session list the reasons of a skip.

Sessions that began before have none: their pages list them as the plan does.

Revision: 0011, after 0010.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("sessions", sa.Column("skip_reason_order", sa.JSON(), nullable=True))


def downgrade() -> None:
    op.drop_column("sessions", "skip_reason_order")
