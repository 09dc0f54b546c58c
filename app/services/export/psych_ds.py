"""Export as a Psych-DS dataset (https://psych-ds.github.io).

Every column of every data file is listed in `variableMeasured`. Names of data files consist of
keyword-value pairs of letters and digits, and end with `_data.csv`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from app.study.folder import text_path

from .filters import in_words
from .relative_times import without_clock_times
from .stream import File, table_file, text_file
from .table import Column, Request
from .tables import DATA_DICTIONARY, ZIPPED, dictionary_of

_TABLES = [without_clock_times(table) for table in ZIPPED if table is not DATA_DICTIONARY]

_READ_ME = """# {title}

A study with PBPO Studio, in which people chose between two videos. {filter}

- `data/`: one table per file. `dataset_description.json` says what each column holds, and so does
  `documentation/data_dictionary.csv`, file by file.
- `materials/`: the plan of the study, and the texts that people read, by language.

Plan {plan_hash}, version {version}. Participants and sessions are named by pseudonyms.
Times are days, and seconds since a session began: a recruitment platform knows to the second
when each of its people came.

Before it is published, `dataset_description.json` needs what only you know: `creator`, `license`,
and `citation`.
"""


def files(request: Request) -> Iterator[File]:
    """The files of the dataset, with paths relative to its root."""
    study = request.study
    yield text_file("dataset_description.json", _pretty(_description(request)))
    yield text_file(
        "README.md",
        _READ_ME.format(
            title=study.plan.text(study.plan.title, study.plan.default_language),
            filter=in_words(request),
            plan_hash=study.plan_hash,
            version=study.plan_version,
        ),
    )
    for table in _TABLES:
        yield table_file(table, request, f"data/{data_name(study.slug, table.name)}")
    yield table_file(dictionary_of(_TABLES), request, "documentation/data_dictionary.csv")
    yield text_file("materials/plan.json", _pretty(study.plan.model_dump(mode="json")))
    for language, texts in sorted(study.texts.items()):
        for name, text in sorted(texts.items()):
            yield text_file(f"materials/{text_path(language, name)}", text)


def data_name(slug: str, table: str) -> str:
    """The name of a table's data file; its values contain only letters and digits."""
    return f"study-{_plain(slug)}_table-{_plain(table)}_data.csv"


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", text)


def _description(request: Request) -> dict[str, Any]:
    study = request.study
    title = study.plan.text(study.plan.title, study.plan.default_language)
    return {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": title,
        "description": f"Choices between two videos in the study {study.slug}: {title}.",
        "version": study.plan_hash,
        "inLanguage": list(study.plan.languages),
        "measurementTechnique": "Two-choice queries with preference-based Bayesian optimisation",
        "variableMeasured": list(_variables(request)),
    }


def _variables(request: Request) -> Iterator[dict[str, str]]:
    """One entry for each column name. If files define it differently, all definitions are given."""
    found: dict[str, list[tuple[str, Column]]] = {}
    for table in _TABLES:
        for column in table.columns(request.study.plan):
            found.setdefault(column.name, []).append((table.name, column))
    for name, uses in found.items():
        said = list(dict.fromkeys(column.description for _, column in uses))
        if len(said) > 1:
            said = [f"{table}: {column.description}" for table, column in uses]
        units = {column.unit for _, column in uses if column.unit}
        yield {
            "@type": "PropertyValue",
            "name": name,
            "description": " ".join(said),
            **({"unitText": units.pop()} if len(units) == 1 else {}),
        }


def _pretty(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, indent=2) + "\n"
