"""Machines, the rollouts asked of them, and queries whose videos do not exist yet

Revision: 0009, after 0008.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

OUTSTANDING = sa.text("status IN ('asked', 'claimed')")
STATUS = "status IN ('asked', 'claimed', 'recorded', 'failed', 'unsafe', 'cancelled', 'withdrawn')"


def upgrade() -> None:
    # Not as a batch, which copies the table and would forget that its ids never come again.
    op.add_column(
        "studies", sa.Column("machines_stopped_at", sa.DateTime(timezone=True), nullable=True)
    )
    with op.batch_alter_table("candidates") as batch:
        batch.add_column(sa.Column("point_key", sa.String(length=200), nullable=True))
        batch.create_unique_constraint(
            op.f("uq_candidates_study_id_environment_point_key"),
            ["study_id", "environment", "point_key"],
        )
    _create_machines()
    _create_rollouts()
    with op.batch_alter_table("queries") as batch:
        batch.alter_column("left_recording_id", existing_type=sa.Integer(), nullable=True)
        batch.alter_column("right_recording_id", existing_type=sa.Integer(), nullable=True)
        for side in ("left", "right"):
            batch.add_column(sa.Column(f"{side}_rollout_id", sa.Integer(), nullable=True))
            batch.create_foreign_key(
                op.f(f"fk_queries_{side}_rollout_id_rollouts"),
                "rollouts",
                [f"{side}_rollout_id"],
                ["id"],
            )
            batch.create_index(op.f(f"ix_queries_{side}_rollout_id"), [f"{side}_rollout_id"])
        batch.add_column(sa.Column("proposed_from", sa.JSON(), nullable=True))
        batch.add_column(sa.Column("withdrawn_at", sa.DateTime(timezone=True), nullable=True))
    op.add_column("acquired", sa.Column("computed_from", sa.JSON(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("acquired") as batch:
        batch.drop_column("computed_from")
    op.execute("DELETE FROM queries WHERE left_recording_id IS NULL OR right_recording_id IS NULL")
    with op.batch_alter_table("queries") as batch:
        batch.drop_column("withdrawn_at")
        batch.drop_column("proposed_from")
        for side in ("left", "right"):
            batch.drop_index(op.f(f"ix_queries_{side}_rollout_id"))
            batch.drop_constraint(
                op.f(f"fk_queries_{side}_rollout_id_rollouts"), type_="foreignkey"
            )
            batch.drop_column(f"{side}_rollout_id")
        batch.alter_column("right_recording_id", existing_type=sa.Integer(), nullable=False)
        batch.alter_column("left_recording_id", existing_type=sa.Integer(), nullable=False)
    op.drop_table("rollouts")
    op.drop_table("machines")
    with op.batch_alter_table("candidates") as batch:
        batch.drop_constraint(op.f("uq_candidates_study_id_environment_point_key"), type_="unique")
        batch.drop_column("point_key")
    op.drop_column("studies", "machines_stopped_at")


def _create_machines() -> None:
    op.create_table(
        "machines",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=60), nullable=False),
        sa.Column("token_hash", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("revoked_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("last_seen_at", sa.DateTime(timezone=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["study_id"],
            ["studies.id"],
            name=op.f("fk_machines_study_id_studies"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_machines")),
        sa.UniqueConstraint("study_id", "name", name=op.f("uq_machines_study_id_name")),
        sa.UniqueConstraint("token_hash", name=op.f("uq_machines_token_hash")),
    )


def _create_rollouts() -> None:
    op.create_table(
        "rollouts",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("public_id", sa.String(length=32), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("environment", sa.String(length=60), nullable=False),
        sa.Column("candidate_id", sa.Integer(), nullable=False),
        sa.Column("run_index", sa.Integer(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("reason", sa.String(length=10), nullable=False),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("trial_id", sa.Integer(), nullable=True),
        sa.Column("status", sa.String(length=10), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("machine_id", sa.Integer(), nullable=True),
        sa.Column("lease_until", sa.DateTime(timezone=True), nullable=True),
        sa.Column("progress", sa.Double(), nullable=True),
        sa.Column("asked_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("claimed_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("ended_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("explanation", sa.Text(), nullable=True),
        sa.Column("failures", sa.JSON(), server_default="[]", nullable=False),
        sa.Column("recording_id", sa.Integer(), nullable=True),
        sa.Column("sha256", sa.String(length=64), nullable=True),
        sa.Column("score", sa.Double(), nullable=True),
        sa.Column("series", sa.JSON(), nullable=True),
        sa.CheckConstraint(STATUS, name=op.f("ck_rollouts_status")),
        sa.CheckConstraint(
            "reason IN ('query', 'ahead', 'acquired')", name=op.f("ck_rollouts_reason")
        ),
        sa.CheckConstraint("attempt >= 0", name=op.f("ck_rollouts_attempt")),
        sa.CheckConstraint(
            "progress IS NULL OR (progress >= 0 AND progress <= 1)",
            name=op.f("ck_rollouts_progress"),
        ),
        sa.ForeignKeyConstraint(
            ["study_id"],
            ["studies.id"],
            name=op.f("fk_rollouts_study_id_studies"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["candidate_id"],
            ["candidates.id"],
            name=op.f("fk_rollouts_candidate_id_candidates"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["trial_id"],
            ["trials.id"],
            name=op.f("fk_rollouts_trial_id_trials"),
            ondelete="SET NULL",
        ),
        sa.ForeignKeyConstraint(
            ["machine_id"],
            ["machines.id"],
            name=op.f("fk_rollouts_machine_id_machines"),
            ondelete="SET NULL",
        ),
        sa.ForeignKeyConstraint(
            ["recording_id"],
            ["recordings.id"],
            name=op.f("fk_rollouts_recording_id_recordings"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_rollouts")),
        sa.UniqueConstraint("public_id", name=op.f("uq_rollouts_public_id")),
        sa.UniqueConstraint(
            "candidate_id", "run_index", name=op.f("uq_rollouts_candidate_id_run_index")
        ),
    )
    op.create_index(
        "ix_rollouts_study_id_status_priority", "rollouts", ["study_id", "status", "priority"]
    )
    op.create_index(op.f("ix_rollouts_trial_id"), "rollouts", ["trial_id"])
    op.create_index(op.f("ix_rollouts_recording_id"), "rollouts", ["recording_id"])
    op.create_index(
        "uq_rollouts_outstanding",
        "rollouts",
        ["candidate_id"],
        unique=True,
        sqlite_where=OUTSTANDING,
        postgresql_where=OUTSTANDING,
    )
