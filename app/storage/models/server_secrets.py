"""Table of the server's secret: one row, which no export reads."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import CheckConstraint, LargeBinary
from sqlalchemy.orm import Mapped, mapped_column

from .studies import Base


class ServerSecret(Base):
    """Random bytes from which the server derives its keys. There is at most one row."""

    __tablename__ = "server_secrets"
    __table_args__ = (CheckConstraint("id = 1", name="one_row"),)

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    secret: Mapped[bytes] = mapped_column(LargeBinary)
    created_at: Mapped[datetime]
