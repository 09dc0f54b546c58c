"""What the answers say about a box: the fits to the points shown, asked about any others."""

from collections.abc import Callable
from typing import Final

import numpy as np

from . import box_design
from .box import Box
from .candidates import FloatArray
from .model_averaging import Average, FittedScale, fitted_parts, predicted
from .posterior_maximum import MeanFunction, ascend
from .safety import LIKELY, Safety
from .settings import Settings
from .skip_synthesis import Learned

#: Points around which the design is refined: so many of the best by mean, and by upper bound.
REFINED: Final = 3
#: Deviations above the mean of that upper bound.
UPPER: Final = 2.0

#: Fits to points in kernel coordinates (n, d) of which some rows lie below the threshold, and the
#: weights of the fits, or None for those by evidence.
FitToPoints = Callable[[FloatArray, tuple[int, ...]], tuple[list[FittedScale], FloatArray | None]]


def fit_of_one(learned: Learned, settings: Settings) -> FitToPoints:
    """The fits to one person's answers."""

    def fit(seen: FloatArray, below: tuple[int, ...]) -> tuple[list[FittedScale], None]:
        return fitted_parts(seen, learned.preferences, learned.skips, settings, below), None

    return fit


#: Starts of the search for the maximum of the mean.
STARTS: Final = 12


class BoxBelief:
    """The mixture of fits at all length scales.

    whole: (n, d), points over the whole box.  shown: (p, d), points that answers name by row.
    excluded: (e, d), points learned to lie below the threshold.  fit: makes the fits.
    """

    def __init__(
        self,
        box: Box,
        whole: FloatArray,
        shown: FloatArray,
        excluded: FloatArray,
        fit: FitToPoints,
        settings: Settings,
    ) -> None:
        self._box, self._whole, self._settings = box, whole, settings
        self._shown, self._excluded = shown, excluded
        rows = {key: row for row, key in enumerate(box.keys(shown))}
        unshown = [key not in rows for key in box.keys(excluded)]
        self._fitted_to = np.vstack([shown, excluded[unshown]])
        for key in box.keys(excluded):
            rows.setdefault(key, len(rows))
        below = sorted(rows[key] for key in box.keys(excluded))
        self._parts, self._weights = fit(box.kernel_coordinates(self._fitted_to), tuple(below))
        self._maximum: FloatArray | None = None

    def over(self, points: FloatArray) -> Average:
        """The belief over points (n, d) of which the first are those it was fitted to."""
        seen = self._box.kernel_coordinates(points)
        return predicted(seen, self._parts, self._settings, self._weights)

    def at(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation at points (k, d); (k,) each."""
        average = self.over(np.vstack([self._fitted_to, points]))
        first = len(self._fitted_to)
        return average.mean[first:].copy(), average.std[first:].copy()

    def design(self, rng: np.random.Generator) -> FloatArray:
        """The points fitted to, then those over the whole box and around what is good; (n, d)."""
        points = np.vstack([self._fitted_to, self._whole])
        if self._box.grid is None:
            average = self.over(points)
            by_mean = np.argsort(-average.mean, kind="stable")[:REFINED]
            bound = average.mean + UPPER * average.std
            by_bound = np.argsort(-bound, kind="stable")[:REFINED]
            centres = points[np.unique(np.append(by_mean, by_bound))]
            points = np.vstack([points, box_design.around(self._box, centres, rng)])
        return self._without_repeats(points)

    def maximum(self) -> FloatArray:
        """The point with the largest mean of those that are likely to be safe; (d,).

        Searched for once.
        """
        if self._maximum is None:
            self._maximum = self._found_maximum()
        return self._maximum.copy()

    def _found_maximum(self) -> FloatArray:
        points = self._without_repeats(np.vstack([self._fitted_to, self._whole]))
        average = self.over(points)
        barred = set(self._box.keys(self._excluded))
        keys = self._box.keys(points)
        order = [row for row in np.argsort(-average.mean, kind="stable") if keys[row] not in barred]
        safety = Safety(self._box, self._shown, self._excluded)
        likely = safety.probability(points) >= LIKELY
        order = [row for row in order if likely[row]] or order
        if self._box.grid is not None:
            return np.array(points[order[0]])
        starts = points[order[:STARTS]]
        function = MeanFunction(
            self._box.kernel_coordinates(self._fitted_to),
            self._parts,
            average.weights,
            self._settings.signal_variance,
        )
        found = [
            point
            for point in ascend(self._box, function, starts)
            if self._box.key(point) not in barred
        ]
        if found and safety.is_in_doubt:
            likely = safety.probability(np.array(found)) >= LIKELY
            found = [point for point, is_likely in zip(found, likely, strict=True) if is_likely]
        tried = np.vstack([starts, *found])
        mean, _ = function(self._box.kernel_coordinates(tried))
        return np.array(tried[int(np.argmax(mean))])

    def _without_repeats(self, points: FloatArray) -> FloatArray:
        """The points fitted to as they are, then the others that are not among those before."""
        first = len(self._fitted_to)
        keys = self._box.keys(points)
        known = set(keys[:first])
        kept = []
        for row, key in enumerate(keys[first:], start=first):
            if key not in known:
                known.add(key)
                kept.append(row)
        return np.vstack([points[:first], points[kept]])
