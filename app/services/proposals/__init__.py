"""What follows a history: trial schedule, proposals of the optimiser, and their caches."""
