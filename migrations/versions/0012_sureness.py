"""How sure a trial was of its acquired candidate, after each response.

Candidates acquired before have none.

Revision: 0012, after 0011.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("acquired", sa.Column("sureness", sa.Double(), nullable=True))


def downgrade() -> None:
    op.drop_column("acquired", "sureness")
