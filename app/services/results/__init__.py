"""Results of a study across its sessions, and of single trials: tidy tables and sentences.

`registry` and `trial_learning` compute the tables; `charts` draws them with app.figures.
"""
