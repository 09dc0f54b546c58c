"""Preference learning: which candidate, of a list or in a box, does an evaluator like best?

    from app.pbbo import PreferenceOptimizer

    optimizer = PreferenceOptimizer(candidates, method="pbpo", seed=0)
    query = optimizer.ask()
    optimizer.tell(query, "left")
    optimizer.best()

The names below are the public interface; everything else may change. See docs/optimiser.md.
"""

import os

# Read when NumPy and SciPy load, so before anything below; a user who sets a number keeps it. Why:
# one_thread.py.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from .box import Box
from .box_optimizer import BoxOptimizer
from .box_query import BoxQuery
from .engine import EARLIER_PEOPLE_ENGINES, ENGINE_VERSION
from .errors import (
    BoxError,
    CandidatesError,
    ConstraintError,
    FitError,
    HistoryError,
    NoPosteriorError,
    PbboError,
    PersonError,
    PointError,
    QueryNotAskedError,
    ScoreError,
    SeedError,
    SettingsError,
    SkipNotOfferedError,
    SkipReasonError,
    SurenessError,
    UnknownMethodError,
    UnknownResponseError,
)
from .methods import METHODS, allows_skip, has_posterior, learns_reasons
from .optimizer import PreferenceOptimizer
from .people_settings import PeopleSettings
from .preferences import RESPONSES, SKIP_REASONS, Preference, Query, Response, SkipReason
from .score_optimizer import SCORE_METHODS, SCORE_PRESETS, ScoreOptimizer
from .settings import PRESETS, ScoreSettings, Settings, defaults_under

__all__ = [
    "EARLIER_PEOPLE_ENGINES",
    "ENGINE_VERSION",
    "METHODS",
    "PRESETS",
    "RESPONSES",
    "SCORE_METHODS",
    "SCORE_PRESETS",
    "SKIP_REASONS",
    "Box",
    "BoxError",
    "BoxOptimizer",
    "BoxQuery",
    "CandidatesError",
    "ConstraintError",
    "FitError",
    "HistoryError",
    "NoPosteriorError",
    "PbboError",
    "PeopleSettings",
    "PersonError",
    "PointError",
    "Preference",
    "PreferenceOptimizer",
    "Query",
    "QueryNotAskedError",
    "Response",
    "ScoreError",
    "ScoreOptimizer",
    "ScoreSettings",
    "SeedError",
    "Settings",
    "SettingsError",
    "SkipNotOfferedError",
    "SkipReason",
    "SkipReasonError",
    "SurenessError",
    "UnknownMethodError",
    "UnknownResponseError",
    "allows_skip",
    "defaults_under",
    "has_posterior",
    "learns_reasons",
]
