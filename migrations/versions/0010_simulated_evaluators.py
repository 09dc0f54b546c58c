"""What a simulated session was answered by: the kind of evaluator, its settings and its seed.

Sessions that were simulated before have none.

Revision: 0010, after 0009.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("sessions", sa.Column("evaluator", sa.JSON(), nullable=True))


def downgrade() -> None:
    op.drop_column("sessions", "evaluator")
