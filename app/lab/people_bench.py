"""`python -m app.lab.people_bench`: what one step costs where several people teach one model.

A step is one more answer and that person's next query. Answers are those of simulated people, with
a quarter of the taste their own, to random pairs: the hardest history there is, since hardly a pair
comes twice. The model fits everything afresh at certain numbers of answers and updates between;
`--sets N` measures what that costs in regret, beside fitting everything afresh.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from statistics import median  # noqa: E402
from time import process_time  # noqa: E402
from typing import Final  # noqa: E402

import numpy as np  # noqa: E402

from app.pbbo import PeopleSettings, PreferenceOptimizer  # noqa: E402

from .consensus_methods import METHOD  # noqa: E402
from .consensus_sets import Entry, answered, entry, grid, population, regret, taste  # noqa: E402
from .consensus_tables import with_error  # noqa: E402
from .several_people import drawn_traits, valued  # noqa: E402

#: People, and answers in all.
SIZES: Final = ((20, 600), (50, 1500), (200, 6000))
OWN_SHARE: Final = 0.25
SEED: Final = 0
STEPS: Final = 10
#: Where the regret of summaries is measured: people and answers, most of them after a full fit.
REGRET_SIZE: Final = (20, 325)
#: Ways to take older answers: as the model does; in no summary between full fits; all afresh.
WAYS: Final = {
    "summaries": PeopleSettings(),
    "last full fit": PeopleSettings(summarised_after=10**6),
    "all afresh": PeopleSettings(growth=1.0),
}


def history(people: int, answers: int, seed: int = SEED) -> list[Entry]:
    """What so many people answer in turn, so many answers in all."""
    each = -(-answers // people)
    said = []
    for number in range(people):
        rng = np.random.default_rng([seed, number])
        values = valued(population(seed), taste(seed, number), OWN_SHARE)
        traits = drawn_traits("honest", rng)
        said.append(answered(f"p{number}", traits, values, each, rng))
    turns = [answer for turn in zip(*said, strict=True) for answer in turn]
    return [entry(answer) for answer in turns[:answers]]


def costs(people: int, answers: int, steps: int = STEPS) -> tuple[float, float]:
    """Milliseconds of processor time: of a full fit and its query, and the median update's.

    The full fit is the last one up to so many answers, the updates are those just before them.
    """
    settings = PeopleSettings()
    said = history(people, answers)
    full = settings.last_full_fit(answers)
    optimizer = PreferenceOptimizer.replay(grid(), said[:full], method=METHOD)
    start = process_time()
    optimizer.ask(said[full - 1][4])
    fitted = 1e3 * (process_time() - start)
    begin = max(full + 1, answers - steps)
    optimizer = PreferenceOptimizer.replay(grid(), said[:begin], method=METHOD)
    # The full fit that an earlier step has left behind.
    optimizer.best()
    updates = []
    for *_, person in said[begin:answers]:
        optimizer.tell(optimizer.ask(person), "left", person=person)
        start = process_time()
        optimizer.ask(person)
        updates.append(1e3 * (process_time() - start))
    return fitted, median(updates)


def regrets(seed: int) -> list[float]:
    """Regret of the population's best by each of `WAYS`, as a share of the range."""
    said = history(*REGRET_SIZE, seed)
    bests = [
        PreferenceOptimizer.replay(grid(), said, method=METHOD, people=way).best()
        for way in WAYS.values()
    ]
    return [regret(population(seed), best) for best in bests]


def print_regrets(sets: int, first_seed: int) -> None:
    """What summaries cost, on so many sets."""
    found = np.array([regrets(seed) for seed in range(first_seed, first_seed + sets)])
    people, answers = REGRET_SIZE
    print(f"\n{people} people, {answers} answers, {sets} sets\n\n| | regret | less all afresh |")
    print("|---|---|---|")
    for name, own in zip(WAYS, found.T, strict=True):
        away = with_error(list(own - found[:, -1]), sign="+")
        print(f"| {name} | {with_error(list(own))} | {away} |")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m app.lab.people_bench", description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--sizes", nargs="+", type=int, help="people and answers, in turn")
    parser.add_argument("--sets", type=int, default=0, help="sets to measure regret on")
    parser.add_argument("--first-seed", type=int, default=200_000)
    options = parser.parse_args(arguments)
    given = options.sizes
    sizes = list(zip(given[::2], given[1::2], strict=True)) if given else list(SIZES)
    print(f"One step over {len(grid())} candidates, ms of processor time, one core\n")
    print("| people | answers | a full fit | an update |")
    print("|---|---|---|---|")
    for people, answers in sizes:
        fitted, updated = costs(people, answers, options.steps)
        print(f"| {people} | {answers} | {fitted:.0f} | {updated:.0f} |", flush=True)
    if options.sets:
        print_regrets(options.sets, options.first_seed)


if __name__ == "__main__":
    main()
