"""Foundations of all services: errors, settings, ids, logs, metrics and child processes."""
