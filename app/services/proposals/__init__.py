"""The next query of a trial: trial schedule, proposals of the optimiser, and their caches."""
