"""`python -m app.lab.consensus`: do several people find together what they like best?

    python -m app.lab.consensus --out build/consensus --sets 500 --first-seed 200000

Sets of simulated people answer random pairs, and several methods judge the same answers. Every
finished case of a set is some lines of `OUT/rows.csv`, so a run that was stopped goes on where it
was. A case is found again by a digest of what determines it, the engine's version included.
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
from collections.abc import Callable, Iterator, Sequence  # noqa: E402
from dataclasses import astuple, fields  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Final  # noqa: E402

from app.pbbo import ENGINE_VERSION, PeopleSettings  # noqa: E402

from .consensus_methods import METHODS, Row, installed, judged  # noqa: E402
from .consensus_sets import CASES, SIDE, STEEPNESS  # noqa: E402
from .consensus_tables import tables  # noqa: E402
from .engines import ENGINES, Engine, run_each  # noqa: E402

#: Settings are chosen on seeds below 100,000 and decided on from here on, once.
DECIDING_SEED: Final = 200_000
SETS: Final = 500

COLUMNS: Final = tuple(field.name for field in fields(Row))


class RowFile:
    """Finished cases of sets; lines that were cut off by a crash are none of them."""

    def __init__(self, folder: Path, methods: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "rows.csv"
        self._methods = tuple(methods)
        if not self._path.is_file():
            self._path.write_text(_line(["made_by", *COLUMNS]))

    def rows(self) -> list[Row]:
        """Every row that this version of engine and cases would give again."""
        text = self._path.read_text()
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._path.write_text(whole)
        found = []
        for line in csv.DictReader(io.StringIO(whole)):
            name = line["case"]
            if name in CASES and line["made_by"] == made_by(name, self._methods):
                found.append(_row(line))
        return found

    def keep(self, rows: Sequence[Row]) -> None:
        """Append what came of a set's cases."""
        lines = [_line([made_by(row.case, self._methods), *astuple(row)]) for row in rows]
        with self._path.open("a") as file:
            file.write("".join(lines))


def made_by(case: str, methods: Sequence[str]) -> str:
    """A digest of what determines a case's rows besides the seed."""
    what = (ENGINE_VERSION, PeopleSettings(), CASES[case], SIDE, STEEPNESS, tuple(methods))
    return hashlib.sha256(repr(what).encode()).hexdigest()[:12]


def run(
    seeds: Sequence[int],
    cases: Sequence[str],
    file: RowFile,
    methods: Sequence[str],
    *,
    engine: Engine = "local",
    jobs: int = 1,
    report: Callable[[str], object] = print,
) -> Iterator[Row]:
    """The rows of these cases of these sets, those kept in the file first."""
    wanted = {*cases}
    done: dict[int, set[str]] = {}
    for row in file.rows():
        if row.seed in seeds and row.case in wanted:
            done.setdefault(row.seed, set()).add(row.case)
            yield row
    missing = [
        (seed, left, methods)
        for seed in seeds
        if (left := [case for case in cases if case not in done.get(seed, ())])
    ]
    report(f"{len(missing)} sets to run")
    for rows in run_each(judged, missing, engine=engine, jobs=jobs):
        file.keep(rows)
        yield from rows


def _row(line: dict[str, str]) -> Row:
    def number(name: str) -> float | None:
        return float(line[name]) if line[name] else None

    def count(name: str) -> int | None:
        return int(line[name]) if line[name] else None

    return Row(
        line["case"],
        int(line["seed"]),
        line["method"],
        float(line["consensus"]),
        float(line["these"]),
        number("personal"),
        count("honest_named"),
        count("unreliable_named"),
        number("own_share"),
    )


def _line(cells: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the sets that are missing, keep them, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m app.lab.consensus", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="the folder of finished sets")
    parser.add_argument("--sets", type=int, default=SETS)
    parser.add_argument("--first-seed", type=int, default=DECIDING_SEED)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=installed())
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.sets)
    found = run(
        seeds,
        options.cases,
        RowFile(options.out, options.methods),
        options.methods,
        engine=options.engine,
        jobs=options.jobs,
    )
    print(tables(list(found)))


if __name__ == "__main__":
    main()
