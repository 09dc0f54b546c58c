"""Rollouts: recordings that machines make while a study runs, from request to outcome."""
