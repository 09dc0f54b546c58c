"""Export for Optuna: a SQLite storage in which each of our trials is a preferential study.

Terms differ: a trial of ours is a study of Optuna's, and a candidate is a trial of Optuna's.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sqlalchemy import event
from sqlalchemy.orm import Session

from app.services.runtime.errors import ConflictError

from .filters import in_words
from .preference_data import LearntTrial, learnt_trials
from .stream import File, text_file
from .table import Request, points

STORAGE = "optuna.sqlite3"
_CHUNK = 1 << 16

_READ_ME = """# {slug} for Optuna

{filter}

`{storage}` is a storage of Optuna, and `optuna-dashboard sqlite:///{storage}` shows it.
Each trial of each person is a preferential study there, `{slug}/<session_id>/<trial_index>`; its
user attributes say the condition. Its trials are the candidates that were compared, with their
parameters and, as user attributes, their index.

```python
from optuna.samplers import RandomSampler
from optuna_dashboard.preferential import load_study

study = load_study(
    study_name="{slug}/<session_id>/0", storage="sqlite:///{storage}", sampler=RandomSampler()
)
for better, worse in study.preferences:
    print(better.params, ">", worse.params)
```
"""


def require() -> None:
    """Raise ConflictError if the packages for this export are not installed."""
    missing = [name for name in ("optuna", "optuna_dashboard") if find_spec(name) is None]
    if missing:
        raise ConflictError(
            f"expected the package {missing[0].replace('_', '-')}, which is not installed:"
            " pip install 'pbpo-studio[optuna]'"
        )


def files(request: Request) -> Iterator[File]:
    """The files of the export: README.md and the storage."""
    said = {"slug": request.study.slug, "filter": in_words(request), "storage": STORAGE}
    yield text_file("README.md", _READ_ME.format(**said))
    yield File(STORAGE, lambda session: _storage(session, request))


def _storage(db: Session, request: Request) -> Iterator[bytes]:
    """Let Optuna write a temporary file, and stream it."""
    with tempfile.TemporaryDirectory(prefix="pbpo-optuna-") as folder:
        path = Path(folder) / STORAGE
        with _optuna_storage(path) as storage:
            spans = _spans(points(db, request))
            for trial in learnt_trials(db, request):
                _add(storage, request, trial, spans[trial.environment])
        with path.open("rb") as file:
            while piece := file.read(_CHUNK):
                yield piece


@contextmanager
def _optuna_storage(path: Path) -> Iterator[Any]:
    import optuna  # noqa: PLC0415 - an extra

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = optuna.storages.RDBStorage(f"sqlite:///{path}")

    @event.listens_for(storage.engine, "connect")
    def _quickly(connection: Any, _record: object) -> None:
        # The file is private and is written again after an error, so durability is not needed.
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute("PRAGMA journal_mode = MEMORY")

    # Close the connections that were opened to create the tables: they lack these settings.
    storage.remove_session()
    storage.engine.dispose()
    try:
        yield storage
    finally:
        storage.remove_session()
        storage.engine.dispose()


def _spans(by_candidate: dict[tuple[str, int], Any]) -> dict[str, list[tuple[float, float]]]:
    """Minimum and maximum of each parameter, by environment."""
    rows: dict[str, list[Any]] = {}
    for (environment, _), values in by_candidate.items():
        rows.setdefault(environment, []).append(values)
    return {
        environment: [(min(column), max(column)) for column in zip(*of, strict=True)]
        for environment, of in rows.items()
    }


def _add(
    storage: Any, request: Request, learnt: LearntTrial, spans: list[tuple[float, float]]
) -> None:
    import optuna  # noqa: PLC0415 - an extra
    from optuna_dashboard.preferential import create_study  # noqa: PLC0415 - an extra

    names = [parameter.name for parameter in request.study.plan.parameters]
    ranges: dict[str, Any] = {
        name: optuna.distributions.FloatDistribution(low, high)
        for name, (low, high) in zip(names, spans, strict=True)
    }
    with warnings.catch_warnings():
        # Optuna warns that preferential studies are experimental; that concerns the reader.
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study = create_study(
            n_generate=1,
            storage=storage,
            # The default sampler needs BoTorch; none is used here, so any will do.
            sampler=optuna.samplers.RandomSampler(),
            study_name=f"{request.study.slug}/{learnt.session_id}/{learnt.trial_index}",
        )
    for name in ("condition", "method", "environment", "participant_id", "mode"):
        study.set_user_attr(name, getattr(learnt, name))
    for candidate, values in zip(learnt.candidates, learnt.datapoints, strict=True):
        study.add_trial(
            optuna.trial.create_trial(
                params=dict(zip(names, values, strict=True)),
                distributions=ranges,
                user_attrs={"candidate": candidate},
                value=0.0,
            )
        )
    trials = study.get_trials(deepcopy=False)
    for winner, loser in learnt.comparisons:
        study.report_preference(trials[winner], trials[loser])
