"""Monitoring of running studies: sessions, progress, data quality, incidents, and server health."""
