"""Periodic and operational tasks: retention, cleanup, backups, and the tasks of a worker."""
