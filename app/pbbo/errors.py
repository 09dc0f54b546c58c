"""What can be wrong with a call to the optimiser: one named error per kind of mistake.

Every message says what was expected and what came. All of them are `PbboError`, which is a
`ValueError`, so a caller may catch one, or all.
"""


class PbboError(ValueError):
    """A mistake in what was handed to the optimiser, or a fit that did not succeed."""


class CandidatesError(PbboError):
    """The candidates are not a finite (n, d) array of at least two different rows."""


class UnknownMethodError(PbboError):
    """The method's name is not one of those offered."""


class SettingsError(PbboError):
    """A setting is unknown, of the wrong type, or out of its range."""


class SeedError(PbboError):
    """The seed is not a non-negative whole number."""


class HistoryError(PbboError):
    """A stored history holds an entry that no trial over these candidates can contain."""


class QueryNotAskedError(PbboError):
    """A response came for a query that is not the one waiting for a response."""


class UnknownResponseError(PbboError):
    """The response is none of left, right and skip."""


class SkipNotOfferedError(PbboError):
    """A skip came under a method that offers no skip."""


class SkipReasonError(PbboError):
    """A reason is unknown, came without a skip, or the method does not learn from it."""


class PersonError(PbboError):
    """A person is not named as it has to be, or has given no answer."""


class SurenessError(PbboError):
    """A share or probability is not a number in its range."""


class BoxError(PbboError):
    """A box has no inside, or a parameter of it is not described as it should be."""


class ConstraintError(BoxError):
    """A constraint is not linear, names an unknown parameter, or excludes everything."""


class PointError(PbboError):
    """A point or candidate is not in the space, or too few would be left to propose."""


class ScoreError(PbboError):
    """A score told to a `ScoreOptimizer` is not a finite number, or not for what was asked."""


class NoPosteriorError(PbboError):
    """The method keeps no model, so it has no posterior."""


class FitError(PbboError):
    """The variational fit did not reach a usable posterior."""
