"""Export for BoTorch: the input of `PairwiseGP` for each trial, as JSON and as numpy arrays."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from .filters import in_words
from .preference_data import LearntTrial, learnt_trials
from .stream import File, text_file, zip_within
from .table import Request, points

_READ_ME = """# {slug} for BoTorch

{filter}

`trials.json` is a list with an entry for each trial: one optimisation run of one person.

| key | shape | what it is |
|---|---|---|
| `datapoints` | (n, {d}) | parameters of the candidates that were compared: {parameters} |
| `comparisons` | (m, 2) | `[winner, loser]`: rows of `datapoints`, in the order of learning |
| `candidates` | (n,) | the study's index of each row of `datapoints` |
| `origins` | (m,) | `answer`: pressed; `synthesis`: made from a skip |
| `query_indices` | (m,) | the query of the trial that each comparison comes from |

and `session_id`, `participant_id`, `mode`, `trial_index`, `condition`, `method`, `environment`.
`trials.npz` holds `datapoints` and `comparisons` once more, as arrays of numpy named
`<session_id>_<trial_index>_datapoints` and `<session_id>_<trial_index>_comparisons`.
`candidates.json` holds, for each environment, the parameters of all its candidates, by their index.
A trial without any comparison yet has n = 0 and m = 0.

```python
import json

import torch
from botorch.fit import fit_gpytorch_mll
from botorch.models import PairwiseGP, PairwiseLaplaceMarginalLogLikelihood
from botorch.models.transforms import Normalize

trial = json.load(open("trials.json"))[0]
pool = json.load(open("candidates.json"))[trial["environment"]]
datapoints = torch.tensor(trial["datapoints"], dtype=torch.double)
comparisons = torch.tensor(trial["comparisons"], dtype=torch.long)
candidates = torch.tensor(pool, dtype=torch.double)

low, high = candidates.min(0).values, candidates.max(0).values
scale = Normalize(d={d}, bounds=torch.stack([low, high]))
model = PairwiseGP(datapoints, comparisons, input_transform=scale)
fit_gpytorch_mll(PairwiseLaplaceMarginalLogLikelihood(model.likelihood, model))
best = model.posterior(candidates).mean.argmax()
```
"""


def files(request: Request) -> Iterator[File]:
    """The files of the export: README.md, trials.json, trials.npz and candidates.json."""
    names = [parameter.name for parameter in request.study.plan.parameters]
    yield text_file(
        "README.md",
        _READ_ME.format(
            slug=request.study.slug,
            filter=in_words(request),
            d=len(names),
            parameters=", ".join(names),
        ),
    )
    yield File("trials.json", lambda session: _trials_json(session, request))
    yield File("trials.npz", lambda session: zip_within(session, _arrays(session, request)))
    yield File("candidates.json", lambda session: [_candidates_json(session, request)])


def _trials_json(db: Session, request: Request) -> Iterator[bytes]:
    before = "[\n"
    for trial in learnt_trials(db, request):
        yield f"{before}{_json(asdict(trial))}".encode()
        before = ",\n"
    yield b"\n]\n" if before.startswith(",") else b"[]\n"


def _arrays(db: Session, request: Request) -> Iterator[File]:
    """The members of the .npz file, one for each array."""
    width = len(request.study.plan.parameters)
    for trial in learnt_trials(db, request):
        # Reshaped, so that an empty array has two dimensions as well.
        datapoints = np.array(trial.datapoints, dtype=np.float64).reshape(-1, width)
        comparisons = np.array(trial.comparisons, dtype=np.int64).reshape(-1, 2)
        yield _array(trial, "datapoints", datapoints)
        yield _array(trial, "comparisons", comparisons)


def _array(trial: LearntTrial, name: str, values: Any) -> File:
    packed = io.BytesIO()
    np.lib.format.write_array(packed, values, allow_pickle=False)
    path = f"{trial.session_id}_{trial.trial_index}_{name}.npy"
    return File(path, lambda _session: [packed.getvalue()])


def _candidates_json(db: Session, request: Request) -> bytes:
    by_candidate = points(db, request)
    pools: dict[str, list[Any]] = {}
    for environment, index in sorted(by_candidate):
        pools.setdefault(environment, []).append(by_candidate[environment, index])
    return f"{_json(pools)}\n".encode()


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
