"""Experiments without people: simulated evaluators, and what they show of the methods."""
