"""Statistics that the reproduction, the pages and the reports share: samples in, values out.

No web, no database, no clock, no charts.
"""
