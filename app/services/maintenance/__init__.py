"""Periodic and operational work: retention, cleanup, backups, and what a worker runs."""
