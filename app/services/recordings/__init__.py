"""Recordings of candidates: the source of each video, and the stores that hold the files."""
