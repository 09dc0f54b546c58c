"""Each form of a study's data, read back by what it is made for, and held against the tables."""

from __future__ import annotations

import csv
import io
import json
import re
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pandas as pd
import pytest
from optuna_dashboard.preferential import load_study

from app.services import export
from app.services.context import AppContext
from app.services.export import optuna_storage
from app.services.runtime.errors import ConflictError
from tests.conftest import Clock, StudyShelf
from tests.databases import Databases

from .client import Api, Session
from .two_people import TwoPeople

#: Of the specification of Psych-DS, for names of data files.
PSYCH_DS_NAME = r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv"


@pytest.fixture(scope="module")
def people() -> TwoPeople:
    return TwoPeople()


@dataclass(frozen=True)
class Exports:
    """The study's exports over HTTP."""

    client: Api
    api_token: str

    def files(self, form: str, **query: Any) -> Mapping[str, bytes]:
        """What the zip of this format holds, by path."""
        answer = self.client.get(
            "/api/v1/studies/short/export.zip",
            params={"format": form, **query},
            headers={"Authorization": f"Bearer {self.api_token}"},
        )
        assert answer.status_code == 200, answer.text
        with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
            assert archive.testzip() is None
            return {name: archive.read(name) for name in archive.namelist()}

    def table(self, name: str) -> pd.DataFrame:
        return self.client.table(name, self.api_token)


@pytest.fixture
def exports(
    app: AppContext,
    client: Api,
    databases: Databases,
    study_shelf: StudyShelf,
    clock: Clock,
    people: TwoPeople,
) -> Exports:
    people.put_into(app, client, databases, study_shelf, clock)
    return Exports(client, people.api_token)


def test_psych_ds_keeps_the_rules_of_its_specification(exports: Exports) -> None:
    files = exports.files("psych-ds")
    said = json.loads(files["dataset_description.json"])
    assert said["@context"].rstrip("/") == "https://schema.org"
    assert said["@type"] == "Dataset"
    assert said["name"] == "A short study"
    assert len(said["description"]) > 20
    variables = said["variableMeasured"]
    assert {variable["@type"] for variable in variables} == {"PropertyValue"}
    names = [variable["name"] for variable in variables]
    assert len(names) == len(set(names))
    assert all(len(variable["description"]) > 3 for variable in variables)
    assert {v["name"]: v.get("unitText") for v in variables}["left_w0"] == "s"

    data = {name: content for name, content in files.items() if name.startswith("data/")}
    assert len(data) == len(export.ZIPPED) - 1
    columns = set()
    for name, content in data.items():
        assert re.fullmatch(PSYCH_DS_NAME, name.removeprefix("data/")), name
        header, *rows = csv.reader(io.StringIO(content.decode("utf-8"), newline=""))
        assert len(header) == len(set(header)), name
        assert {len(row) for row in rows} <= {len(header)}, name
        columns |= set(header)
    assert columns == set(names)
    assert files["README.md"].startswith(b"# A short study\n")


def test_psych_ds_holds_the_same_tables(exports: Exports) -> None:
    tables, dataset = exports.files("csv"), exports.files("psych-ds")
    for table in export.ZIPPED[:-1]:
        published = dataset[f"data/study-short_table-{table.name}_data.csv"]
        assert without_times(published) == without_times(tables[f"{table.name}.csv"]), table.name
    assert b"Choose the video" in dataset["materials/texts/en/instructions.md"]
    assert json.loads(dataset["materials/plan.json"])["slug"] == "short"


#: A moment of a day, however it is written.
CLOCK_TIME = re.compile(rb"\d\d:\d\d")


def without_times(content: bytes) -> list[list[str]]:
    rows = list(csv.reader(io.StringIO(content.decode("utf-8"), newline="")))
    kept = [place for place, name in enumerate(rows[0]) if not re.search("_(at|on|after_s)$", name)]
    return [[row[place] for place in kept] for row in rows]


def test_psych_ds_holds_no_time_that_a_platforms_list_could_be_joined_by(
    exports: Exports,
) -> None:
    dataset = exports.files("psych-ds")
    data = {name: content for name, content in dataset.items() if name.endswith("_data.csv")}
    assert {name for name, content in data.items() if CLOCK_TIME.search(content)} == set()
    columns: set[str] = set()
    for content in data.values():
        columns |= set(content.decode("utf-8").split("\n", 1)[0].split(","))
    assert {name for name in columns if name.endswith("_at")} == set()

    def table(name: str) -> pd.DataFrame:
        return pd.read_csv(io.BytesIO(data[f"data/study-short_table-{name}_data.csv"]))

    sessions, queries = table("sessions"), table("queries")
    assert sessions["started_on"].to_list() == ["2026-03-01", "2026-03-02"]
    assert (sessions["ended_after_s"].dropna() > 0).all()
    shown = queries["shown_after_s"].dropna()
    assert (shown >= 0).all()
    answered = queries.dropna(subset="answered_after_s")
    assert (answered["answered_after_s"] >= answered["shown_after_s"]).all()
    assert table("participants")["created_on"].to_list() == ["2026-03-01", "2026-03-02"]
    dictionary = pd.read_csv(io.BytesIO(dataset["documentation/data_dictionary.csv"]))
    described = {(row.file, row.column) for row in dictionary.itertuples()}
    assert ("queries.csv", "shown_after_s") in described
    assert not (dictionary["type"] == "datetime").any()
    # The plain tables keep their times: names that others rely on.
    assert b"shown_at" in exports.files("csv")["queries.csv"]


@pytest.mark.parametrize("slug", ["waste-crane", "a-1-b", "short"])
def test_a_slug_with_hyphens_still_makes_names_of_psych_ds(slug: str) -> None:
    from app.services.export.psych_ds import data_name

    assert re.fullmatch(PSYCH_DS_NAME, data_name(slug, "queries"))


def test_botorch_gets_the_points_and_the_preferences_of_each_trial(exports: Exports) -> None:
    files = exports.files("botorch")
    trials = json.loads(files["trials.json"])
    preferences, queries = exports.table("preferences"), exports.table("queries")
    pools = json.loads(files["candidates.json"])
    begun = queries.drop_duplicates(["session_id", "trial_index"])
    assert [(t["session_id"], t["trial_index"]) for t in trials] == list(
        begun[["session_id", "trial_index"]].itertuples(index=False, name=None)
    )
    for trial in trials:
        points = np.array(trial["datapoints"])
        pairs = np.array(trial["comparisons"])
        of_trial = preferences[
            (preferences["session_id"] == trial["session_id"])
            & (preferences["trial_index"] == trial["trial_index"])
        ]
        # PairwiseGP: points are (n, d), comparisons (m, 2) of rows of points, the winner first.
        assert points.shape == (len(trial["candidates"]), 2)
        assert pairs.shape == (len(of_trial), 2)
        assert set(pairs.ravel()) == set(range(len(points)))
        candidates = np.array(trial["candidates"])
        assert candidates[pairs].tolist() == of_trial[["winner", "loser"]].to_numpy().tolist()
        assert trial["origins"] == of_trial["origin"].to_list()
        assert trial["query_indices"] == of_trial["query_index"].to_list()
        pool = np.array(pools[trial["environment"]])
        assert (pool[candidates] == points).all()
    assert {"answer", "synthesis"} == {origin for trial in trials for origin in trial["origins"]}


def test_the_arrays_of_numpy_are_those_of_the_json_and_hold_no_pickle(exports: Exports) -> None:
    files = exports.files("botorch")
    arrays = np.load(io.BytesIO(files["trials.npz"]), allow_pickle=False)
    trials = json.loads(files["trials.json"])
    assert len(arrays.files) == 2 * len(trials)
    for trial in trials:
        name = f"{trial['session_id']}_{trial['trial_index']}"
        assert arrays[f"{name}_datapoints"].dtype == np.float64
        assert arrays[f"{name}_datapoints"].tolist() == trial["datapoints"]
        assert arrays[f"{name}_comparisons"].dtype == np.int64
        assert arrays[f"{name}_comparisons"].tolist() == trial["comparisons"]


def optuna_studies(storage: bytes, folder: Path) -> dict[str, Any]:
    """The preferential studies of a storage, by name, as optuna-dashboard loads them."""
    path = folder / "read.sqlite3"
    path.write_bytes(storage)
    opened = optuna.storages.RDBStorage(f"sqlite:///{path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            sampler = optuna.samplers.RandomSampler()
            return {
                name: load_study(study_name=name, storage=opened, sampler=sampler)
                for name in optuna.get_all_study_names(opened)
            }
    finally:
        opened.remove_session()
        opened.engine.dispose()


def test_optuna_opens_each_trial_as_a_preferential_study(exports: Exports, tmp_path: Path) -> None:
    found = optuna_studies(exports.files("optuna")[optuna_storage.STORAGE], tmp_path)
    preferences, queries = exports.table("preferences"), exports.table("queries")
    begun = queries.drop_duplicates(["session_id", "trial_index"])
    assert set(found) == {f"short/{row.session_id}/{row.trial_index}" for row in begun.itertuples()}
    points = exports.table("recordings").drop_duplicates("candidate").set_index("candidate")
    for row in begun.itertuples():
        study = found[f"short/{row.session_id}/{row.trial_index}"]
        assert study.user_attrs["condition"] == row.condition
        of_trial = preferences[
            (preferences["session_id"] == row.session_id)
            & (preferences["trial_index"] == row.trial_index)
        ]
        learnt = [
            (better.user_attrs["candidate"], worse.user_attrs["candidate"])
            for better, worse in study.preferences
        ]
        # Optuna keeps preferences under random keys: which there are is kept, not their order.
        pairs = of_trial[["winner", "loser"]].itertuples(index=False, name=None)
        assert sorted(learnt) == sorted(pairs)
        for trial in study.trials:
            assert trial.params == points.loc[trial.user_attrs["candidate"], ["w0", "w1"]].to_dict()


def test_what_optuna_needs_is_named_where_it_is_missing(
    exports: Exports, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(optuna_storage, "find_spec", lambda name: None)
    with pytest.raises(
        ConflictError, match=r"the package optuna.*pip install 'pbpo-studio\[optuna"
    ):
        export.find("optuna")
    refused = exports.client.get(
        "/api/v1/studies/short/export.zip?format=optuna",
        headers={"Authorization": f"Bearer {exports.api_token}"},
    )
    assert (refused.status_code, "pbpo-studio[optuna]" in refused.json()["detail"]) == (409, True)


@pytest.mark.parametrize("form", ["csv", "psych-ds", "botorch"])
def test_the_same_data_gives_the_same_bytes(exports: Exports, form: str) -> None:
    assert exports.files(form) == exports.files(form)


def test_who_was_deleted_is_in_no_format_any_more(
    exports: Exports, people: TwoPeople, tmp_path: Path
) -> None:
    sessions = exports.table("sessions")
    gone, stays = sessions["session_id"].iloc[1], sessions["session_id"].iloc[0]
    forms = ("csv", "psych-ds", "botorch")
    for form in forms:
        assert any(gone.encode() in content for content in exports.files(form).values())
    Session(exports.client, people.second_token, {}).call("withdraw", {"delete": True})
    for form in forms:
        files = exports.files(form)
        assert not any(gone.encode() in content for content in files.values()), form
        assert any(stays.encode() in content for content in files.values()), form
    arrays = np.load(io.BytesIO(exports.files("botorch")["trials.npz"]), allow_pickle=False)
    assert not [name for name in arrays.files if gone in name]
    storage = exports.files("optuna")[optuna_storage.STORAGE]
    assert {name.split("/")[1] for name in optuna_studies(storage, tmp_path)} == {stays}
    assert gone.encode() not in storage
    assert exports.table("deletions")["stage"].to_list() == ["query"]


def test_a_study_without_sessions_can_be_had_in_each_format(
    app: AppContext, client: Api, study_shelf: StudyShelf, tmp_path: Path
) -> None:
    from app.services.accounts import accounts

    from .conftest import EMAIL, LEARNING_PLAN, PASSWORD

    study_shelf.put_into(app, LEARNING_PLAN)
    token = accounts.create_api_token(app, accounts.create(app, EMAIL, PASSWORD), "tests")
    exports = Exports(client, token)
    assert json.loads(exports.files("botorch")["trials.json"]) == []
    assert np.load(io.BytesIO(exports.files("botorch")["trials.npz"])).files == []
    assert optuna_studies(exports.files("optuna")[optuna_storage.STORAGE], tmp_path) == {}
    assert "data/study-short_table-queries_data.csv" in exports.files("psych-ds")
