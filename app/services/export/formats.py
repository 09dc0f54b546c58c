"""The registry of export formats."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from app.services.runtime.errors import ConflictError

from . import botorch, optuna_storage, psych_ds, read_me
from .stream import File, table_file, text_file
from .table import Request
from .tables import ZIPPED


@dataclass(frozen=True)
class Format:
    """One export format.

    label, about: shown on the page. require: raises ConflictError if a package is not installed.
    """

    name: str
    label: str
    about: str
    files: Callable[[Request], Iterable[File]]
    require: Callable[[], None] = lambda: None


def _tables(request: Request) -> Iterator[File]:
    for table in ZIPPED:
        yield table_file(table, request)
    yield text_file("README.md", read_me.text(request))


FORMATS: Final[Mapping[str, Format]] = MappingProxyType(
    {
        form.name: form
        for form in (
            Format("csv", "CSV", "Tidy tables and a data dictionary, for pandas or R.", _tables),
            Format(
                "psych-ds",
                "Psych-DS",
                "A dataset to publish: the tables, every column described, plan and texts.",
                psych_ds.files,
            ),
            Format(
                "botorch",
                "BoTorch",
                "For each trial its points, and which of two was preferred, for PairwiseGP.",
                botorch.files,
            ),
            Format(
                "optuna",
                "Optuna",
                "A storage of preferential studies that optuna-dashboard opens.",
                optuna_storage.files,
                optuna_storage.require,
            ),
        )
    }
)


def find(name: str) -> Format:
    """The format of this name. Raises ConflictError if it is unknown or a package is missing."""
    if name not in FORMATS:
        raise ConflictError(f"expected a format among {', '.join(FORMATS)}, got {name!r}")
    FORMATS[name].require()
    return FORMATS[name]
