"""`make bench`: what one step costs, ours beside what a user would pick instead.

A step is one more answer and the next query. All run in this process, on one core, on the same
histories over the same 231 candidates: what an evaluator who errs like Section VI's Uncertain
answers to queries of `pbpo-no-skip`. The cost beyond those lengths is measured on random pairs,
nearly all different: the hardest history there is for us, which no trial produces.
"""

import os

# Before NumPy, SciPy or PyTorch load: one core for everyone.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

import argparse  # noqa: E402
import warnings  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from statistics import median  # noqa: E402
from time import process_time  # noqa: E402
from typing import Final  # noqa: E402

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from app.pbbo import PRESETS, PreferenceOptimizer  # noqa: E402

from .peers import PEERS, Pairs  # noqa: E402

FloatArray = NDArray[np.float64]
Entry = tuple[int, int, str]

LENGTHS: Final = (30, 100, 300)
GROWTH: Final = (30, 100, 300, 1000, 3000)
METHOD: Final = "pbpo-no-skip"
# Steps of 0.05 s on the triangle w0 >= w1 (Section V-D).
STEPS: Final = 21
# A hill about as wide as Env1's plateau, and an evaluator who errs about as often as Uncertain.
PEAK: Final = (0.75, 0.5)
CONSISTENCY: Final = 8.0
REPEATS: Final = 11
PEER_REPEATS: Final = 3


def candidates() -> FloatArray:
    """The crane's 231 parameter vectors; (231, 2)."""
    return np.array([(i, j) for i in range(STEPS) for j in range(i + 1)]) / (STEPS - 1)


def answer(rng: np.random.Generator, taste: FloatArray, left: int, right: int) -> str:
    """Bradley-Terry, as Eq. 16."""
    chance = 1.0 / (1.0 + np.exp(-CONSISTENCY * (taste[left] - taste[right])))
    return "left" if rng.random() < chance else "right"


def asked_history(points: FloatArray, preset: str, length: int, seed: int) -> list[Entry]:
    """What an evaluator answered to the queries of one trial."""
    rng = np.random.default_rng(seed)
    taste = -np.linalg.norm(points - PEAK, axis=1)
    optimizer = PreferenceOptimizer(points, METHOD, seed, PRESETS[preset])
    history: list[Entry] = []
    for _ in range(length):
        query = optimizer.ask()
        response = answer(rng, taste, query.left, query.right)
        optimizer.tell(query, response)
        history.append((query.left, query.right, response))
    return history


def random_history(points: FloatArray, length: int, seed: int) -> list[Entry]:
    """The same evaluator's answers to random pairs."""
    rng = np.random.default_rng(seed)
    taste = -np.linalg.norm(points - PEAK, axis=1)
    history: list[Entry] = []
    for _ in range(length):
        left, right = (int(i) for i in rng.choice(len(points), 2, replace=False))
        history.append((left, right, answer(rng, taste, left, right)))
    return history


def milliseconds(action: Callable[[], object]) -> float:
    """What one call takes of the processor: what else runs beside it is not counted."""
    start = process_time()
    action()
    return 1e3 * (process_time() - start)


def our_step(points: FloatArray, preset: str, history: Sequence[Entry], repeats: int) -> float:
    """Median cost of taking the last answer and finding the next query, ms."""
    costs = []
    for _ in range(repeats):
        optimizer = PreferenceOptimizer.replay(
            points, history[:-1], method=METHOD, settings=PRESETS[preset]
        )
        # What an earlier step has left behind: the prior over the candidates.
        optimizer.ask()
        optimizer = PreferenceOptimizer.replay(
            points, history, method=METHOD, settings=PRESETS[preset]
        )
        costs.append(milliseconds(optimizer.ask))
    return median(costs)


def peer_step(name: str, points: FloatArray, history: Sequence[Entry], repeats: int) -> float:
    """Median cost of the same step with a peer that has taken the step before, ms."""
    pairs: Pairs = [(a, b) if r == "left" else (b, a) for a, b, r in history]
    costs = []
    for seed in range(repeats):
        peer = PEERS[name](points, seed)
        peer.step(pairs[:-1])
        costs.append(milliseconds(lambda peer=peer: peer.step(pairs)))  # type: ignore[misc]
    return median(costs)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m app.lab.bench", description=__doc__)
    parser.add_argument("--without-peers", action="store_true", help="measure only ourselves")
    parser.add_argument("--peer-repeats", type=int, default=PEER_REPEATS, metavar="N")
    options = parser.parse_args(arguments)

    points = candidates()
    preset = "paper-env1"
    history = asked_history(points, preset, max(LENGTHS), seed=0)
    ours = {n: our_step(points, preset, history[:n], REPEATS) for n in LENGTHS}
    sharp = {n: our_step(points, "paper-env2", history[:n], REPEATS) for n in LENGTHS}

    print(f"One step over {len(points)} candidates, median ms, one core\n")
    print(f"{'preferences':32}" + "".join(f"{n:>16}" for n in LENGTHS))
    print(f"{f'{METHOD}, paper-env1':32}" + "".join(f"{ours[n]:16.1f}" for n in LENGTHS))
    print(f"{f'{METHOD}, paper-env2':32}" + "".join(f"{sharp[n]:16.1f}" for n in LENGTHS))
    if not options.without_peers:
        for name in PEERS:
            print(peer_line(name, points, history, ours, options.peer_repeats), flush=True)

    print("\nGrowth on random pairs, median ms\n")
    print(f"{'preferences':32}" + "".join(f"{n:>10}" for n in GROWTH))
    pairs = random_history(points, max(GROWTH), seed=1)
    for name in ("paper-env1", "paper-env2"):
        print(f"{name:32}", end="")
        for n in GROWTH:
            cost = our_step(points, name, pairs[:n], REPEATS if n <= 300 else 1)
            print(f"{cost:10.1f}", end="", flush=True)
        print()


def peer_line(
    name: str,
    points: FloatArray,
    history: Sequence[Entry],
    ours: dict[int, float],
    repeats: int,
) -> str:
    """One peer's costs, and how many of our steps each is."""
    cells = []
    try:
        for n in LENGTHS:
            with warnings.catch_warnings():
                # Their own remarks on input scaling and convergence are not what is measured.
                warnings.simplefilter("ignore")
                cost = peer_step(name, points, history[:n], repeats)
            cells.append(f"{cost:9.0f} {cost / ours[n]:5.0f}x")
    except ModuleNotFoundError as error:
        return f"{name:32} not installed ({error.name}): pip install -e '.[bench]'"
    return f"{name:32}" + "".join(f"{cell:>16}" for cell in cells)


if __name__ == "__main__":
    main()
