"""`python -m app.lab.variants`: trials of variants on all worlds, and the tables that decide.

    python -m app.lab.variants --out build/variants --trials 1000 --first-seed 200000

Every finished trial is a line of `OUT/trials.csv`, so a run that was stopped goes on where it was.
A trial is found again by a digest of its settings and the engine's version as well as by its name:
trials of another engine or of changed settings are run anew and never mixed in.
"""

from __future__ import annotations

import os

# Before NumPy, SciPy or PyTorch load: one core for each process.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import csv  # noqa: E402
import hashlib  # noqa: E402
import io  # noqa: E402
import warnings  # noqa: E402
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Final  # noqa: E402

from app.pbbo import ENGINE_VERSION  # noqa: E402

from .answering import EVALUATORS  # noqa: E402
from .engines import ENGINES, Engine, run_each  # noqa: E402
from .peers import PEERS  # noqa: E402
from .problems import CHOOSING_CRANES, DECIDING_CRANES, FUNCTIONS, PROBLEMS  # noqa: E402
from .variant_definitions import VARIANTS  # noqa: E402
from .variant_tables import tables  # noqa: E402
from .variant_trials import LOOKS, Call, Outcome, calls, run_call  # noqa: E402

#: Settings are chosen on seeds below 100,000 and decided on from here on, once.
DECIDING_SEED: Final = 200_000
TRIALS: Final = 1000

#: Groups of problems that the command line takes by one name.
GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "choosing-cranes": CHOOSING_CRANES,
    "deciding-cranes": DECIDING_CRANES,
    "functions": FUNCTIONS,
}

HEADER: Final = (
    "made_by",
    "variant",
    "problem",
    "evaluator",
    "seed",
    *(f"regret_{look}" for look in LOOKS),
)


class TrialFile:
    """Finished trials, one line each; a line that was cut off by a crash is not one of them."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "trials.csv"
        if not self._path.is_file():
            self._path.write_text(_line(HEADER))

    def outcomes(self) -> dict[Call, Outcome]:
        """Every trial that this version of engine and settings would give again."""
        text = self._path.read_text()
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._path.write_text(whole)
        found = {}
        for row in csv.DictReader(io.StringIO(whole)):
            call = Call(row["variant"], row["problem"], row["evaluator"], int(row["seed"]))
            if row["made_by"] == made_by(call.variant):
                regrets = [row[f"regret_{look}"] for look in LOOKS]
                found[call] = Outcome(call, tuple(float(r) for r in regrets if r))
        return found

    def keep(self, outcome: Outcome) -> None:
        """Append one finished trial."""
        call = outcome.call
        missing = len(LOOKS) - len(outcome.regrets)
        trial = (call.variant, call.problem, call.evaluator, call.seed)
        with self._path.open("a") as file:
            file.write(_line([made_by(call.variant), *trial, *outcome.regrets, *[""] * missing]))


def made_by(variant: str) -> str:
    """A digest of what determines a variant's trials besides the call: engine and settings."""
    what = (ENGINE_VERSION, VARIANTS[variant]) if variant in VARIANTS else variant
    return hashlib.sha256(repr(what).encode()).hexdigest()[:12]


def run(
    wanted: Iterable[Call],
    file: TrialFile,
    *,
    engine: Engine = "local",
    jobs: int = 1,
    queries: int = LOOKS[-1],
    report: Callable[[str], object] = print,
) -> Generator[Outcome, None, None]:
    """All these trials, those kept in the file first; every new one is kept as it comes."""
    kept = file.outcomes()
    missing = []
    for call in wanted:
        if call in kept:
            yield kept[call]
        else:
            missing.append((call, queries))
    report(f"{len(missing)} trials to run")
    for outcome in run_each(run_call, missing, engine=engine, jobs=jobs):
        file.keep(outcome)
        yield outcome


def _line(cells: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials that are missing, keep them, and print the tables."""
    known = [*VARIANTS, *PEERS]
    parser = argparse.ArgumentParser(prog="python -m app.lab.variants", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="the folder of finished trials")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--first-seed", type=int, default=DECIDING_SEED)
    parser.add_argument("--queries", type=int, default=LOOKS[-1])
    parser.add_argument(
        "--problems",
        nargs="+",
        choices=[*PROBLEMS, *GROUPS],
        default=["env1", "env2", "deciding-cranes", "functions"],
    )
    parser.add_argument("--evaluators", nargs="+", choices=list(EVALUATORS), default=["uncertain"])
    parser.add_argument("--variants", nargs="+", choices=known, default=list(VARIANTS))
    parser.add_argument("--against", choices=known, help="the variant that others are paired with")
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    # BoTorch warns of single precision and of points it has jittered; neither is about us.
    warnings.filterwarnings("ignore", module=r"botorch|gpytorch|linear_operator")
    problems = [one for name in options.problems for one in GROUPS.get(name, (name,))]
    seeds = range(options.first_seed, options.first_seed + options.trials)
    wanted = calls(options.variants, problems, options.evaluators, seeds)
    found = list(
        run(
            wanted,
            TrialFile(options.out),
            engine=options.engine,
            jobs=options.jobs,
            queries=options.queries,
        )
    )
    print(tables(found, against=options.against or options.variants[0], groups=GROUPS))


if __name__ == "__main__":
    main()
