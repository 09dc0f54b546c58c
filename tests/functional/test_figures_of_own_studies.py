"""Figures of studies with one, two and three parameters of their own, which lie on no grid."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd
import pytest

from app.services.context import AppContext
from app.services.results.registry import FINDINGS
from app.services.studies import repository
from tests.conftest import Clock

from .client import Api, by_turns
from .own_study import OWN_PLAN, RECORDINGS, write_own_study
from .test_experimenter_pages import sign_in

PARAMETERS = {
    1: ("  - {name: height}\n", "", RECORDINGS.replace(",1,", ",").replace(",-2,", ",")),
    2: ("", "", RECORDINGS),
    3: (
        "  - {name: height}\n",
        "  - {name: height}\n  - {name: grip}\n",
        RECORDINGS.replace(",1,", ",1,0.5,").replace(",-2,", ",-2,0.7,"),
    ),
}


@pytest.mark.parametrize("number", PARAMETERS)
def test_every_figure_of_a_study_of_so_many_parameters_is_drawn(
    client: Api, app: AppContext, clock: Clock, api_token: str, tmp_path: Path, number: int
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    old, new, recordings = PARAMETERS[number]
    plan = OWN_PLAN.replace(old, new) if old else OWN_PLAN
    (folder / "study.yaml").write_text(plan, encoding="utf-8")
    header = {1: "speed", 2: "speed,height", 3: "speed,height,grip"}[number]
    table = recordings.replace("speed,height", header)
    (folder / "recordings.csv").write_text(table, encoding="utf-8")
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    client.start("kettles").to_the_end(by_turns("left", "right"), clock.forward)
    assert sign_in(client).status_code == 303

    for name in FINDINGS.keys() - {"repeats"}:
        answer = client.get(f"/studies/kettles/figures/{name}.svg")
        assert answer.status_code == 200, (name, answer.text)
        assert answer.text.startswith("<svg")

    token = {"Authorization": f"Bearer {api_token}"}
    acquired = pd.read_csv(
        io.BytesIO(client.get("/api/v1/studies/kettles/export/acquired.csv", headers=token).content)
    )
    session_id = acquired["session_id"].iloc[0]
    assert client.get(f"/studies/kettles/sessions/{session_id}").status_code == 200
    with_model = acquired.dropna(subset="posterior_mean")["trial_index"].iloc[0]
    for trial in (0, 1):
        where = f"/studies/kettles/sessions/{session_id}/figures/{trial}"
        assert client.get(f"{where}/path.svg").text.startswith("<svg")
        belief = client.get(f"{where}/posterior.json").json()
        if trial == with_model:
            assert belief["rows"] == 3
            assert client.get(f"{where}/posterior.svg").text.startswith("<svg")
        else:
            assert (belief["rows"], belief["chart"]) == (0, None)
            assert "knockout" in belief["says"]
