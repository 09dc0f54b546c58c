"""Pages of evaluators, under /s/{slug}, and the media that they load."""
