"""Recordings of candidates: where a video comes from, and the stores that keep the files."""
