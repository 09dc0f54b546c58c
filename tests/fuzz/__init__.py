"""Anything, in any order: what `make fuzz` runs for minutes, and `make test` for seconds."""
