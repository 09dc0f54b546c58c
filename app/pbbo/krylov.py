"""Linear systems that are only known by what they do to a vector (GMRES)."""

from collections.abc import Callable

import numpy as np

from app.pbbo.candidates import FloatArray


def gmres(
    apply: Callable[[FloatArray], FloatArray], right: FloatArray, tolerance: float, most: int
) -> FloatArray:
    """x with |apply(x) - right| <= tolerance |right|, or the best found in `most` steps; (m,)."""
    size = float(np.linalg.norm(right))
    if size == 0.0:
        return np.zeros_like(right)
    basis = [right / size]
    hessenberg = np.zeros((most + 1, most))
    target = np.zeros(most + 1)
    target[0] = size
    weights: FloatArray = np.zeros(0)
    for step in range(most):
        image = apply(basis[step])
        for row, direction in enumerate(basis):
            hessenberg[row, step] = direction @ image
            image = image - hessenberg[row, step] * direction
        hessenberg[step + 1, step] = np.linalg.norm(image)
        system = hessenberg[: step + 2, : step + 1]
        weights = np.asarray(np.linalg.lstsq(system, target[: step + 2], rcond=None)[0])
        left = float(np.linalg.norm(system @ weights - target[: step + 2]))
        if left <= tolerance * size or hessenberg[step + 1, step] <= 1e-14 * size:
            break
        basis.append(image / hessenberg[step + 1, step])
    return np.asarray(weights @ np.array(basis[: len(weights)]))
