"""A study of one's own videos, from its folder to its tables; and how videos are served."""

from __future__ import annotations

import io
from pathlib import Path

import av
import pandas as pd
import pytest

from app.services.context import AppContext
from app.services.studies import repository
from app.services.studies.repository import StudyInfo
from tests.conftest import Clock

from .client import Api, by_turns
from .own_study import folder, frames, own_study, write_own_study

__all__ = ["folder", "own_study"]


def table(client: Api, api_token: str, name: str) -> pd.DataFrame:
    address = f"/api/v1/studies/kettles/export/{name}.csv"
    response = client.get(address, headers={"Authorization": f"Bearer {api_token}"})
    assert response.status_code == 200, response.text
    return pd.read_csv(io.BytesIO(response.content))


@pytest.fixture
def url(client: Api, own_study: StudyInfo) -> str:
    """Address of a video that an evaluator is shown."""
    state = client.start("kettles").to_first_query().state
    return str(state["query"]["left"]["url"])


def test_a_study_of_ones_own_walks_to_the_end_and_into_its_tables(
    client: Api, own_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    session = client.start("kettles")
    pressed = session.to_the_end(by_turns("left", "skip", "right", "left"), clock.forward)
    assert session.state["stage"] == "completed"

    queries = table(client, api_token, "queries")
    assert queries["response"].to_list() == [one.response for one in pressed]
    assert {"left_speed", "right_speed", "left_height", "right_height"} <= set(queries.columns)
    assert sorted(queries["method"].unique()) == ["knockout", "pbpo"]
    recordings = table(client, api_token, "recordings")
    assert recordings["recording"].to_list() == [
        "kitchen-0-0",
        "kitchen-0-1",
        "kitchen-1-0",
        "kitchen-2-0",
    ]
    assert recordings["speed"].to_list() == [0.1, 0.1, 0.2, 0.3]
    assert recordings["score"].fillna(0).to_list() == [-3.5, 0, -10, 2]
    assert recordings["duration_s"].to_list() == pytest.approx([0.4] * 4)
    knockout = queries[queries["method"] == "knockout"]["trial_index"].iloc[0]
    acquired = table(client, api_token, "acquired").set_index("trial_index")
    assert acquired.loc[knockout, "posterior_mean"].isna().all()


def test_under_knockout_the_winner_meets_the_next_one(
    client: Api, own_study: StudyInfo, clock: Clock, api_token: str
) -> None:
    client.start("kettles").to_the_end(by_turns("right", "left"), clock.forward)
    queries = table(client, api_token, "queries")
    trial = queries[queries["method"] == "knockout"].reset_index(drop=True)
    for before, after in zip(trial.itertuples(), trial.iloc[1:].itertuples(), strict=False):
        assert before.chosen_candidate in (after.left_candidate, after.right_candidate)


def test_names_of_conditions_may_hold_spaces(
    client: Api, own_study: StudyInfo, api_token: str
) -> None:
    client.start("kettles")
    conditions = table(client, api_token, "sessions")["conditions"].iloc[0]
    assert sorted(conditions.split("; ")) == ["last one wins", "with skip"]


def test_a_session_speaks_the_language_it_was_begun_in(client: Api, own_study: StudyInfo) -> None:
    session = client.start("kettles", language="ja")
    assert session.state["study"]["title"] == "やかん"
    assert "日本語" in session.state["consent"]["html"]
    assert client.start("kettles", language="fr").state["language"] == "en"


def test_a_video_is_what_the_folder_holds(
    client: Api, own_study: StudyInfo, folder: Path, url: str
) -> None:
    response = client.get(url)
    assert response.status_code == 200
    assert response.headers["content-type"] == "video/mp4"
    assert response.headers["accept-ranges"] == "bytes"
    assert "immutable" in response.headers["cache-control"]
    assert frames(response.content) in [frames(video) for video in (folder / "videos").iterdir()]


PARTS = [("bytes=0-99", 0, 100), ("bytes=100-", 100, None), ("bytes=-7", -7, None)]


@pytest.mark.parametrize(("asked", "start", "end"), PARTS)
def test_a_part_of_a_video_is_sent_as_a_part(
    client: Api, url: str, asked: str, start: int, end: int | None
) -> None:
    whole = client.get(url).content
    part = client.get(url, headers={"Range": asked})
    assert part.status_code == 206
    assert part.content == whole[start:end]
    assert part.headers["content-range"].endswith(f"/{len(whole)}")


def test_a_part_beyond_the_end_is_refused(client: Api, url: str) -> None:
    refusal = client.get(url, headers={"Range": "bytes=99999999-"})
    assert refusal.status_code == 416


def test_a_browser_that_has_the_video_is_not_sent_it_again(client: Api, url: str) -> None:
    whole = client.get(url)
    again = client.get(url, headers={"If-None-Match": whole.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["cache-control"] == whole.headers["cache-control"]


def test_head_tells_the_length_and_sends_nothing(client: Api, url: str) -> None:
    head = client.request("HEAD", url)
    assert (head.status_code, head.content) == (200, b"")
    assert int(head.headers["content-length"]) == len(client.get(url).content)


@pytest.mark.parametrize("name", ["nothing.mp4", "..%2f..%2fpbpo.sqlite3.mp4"])
def test_a_video_that_is_not_there_is_not_found(
    client: Api, own_study: StudyInfo, name: str
) -> None:
    refusal = client.get(f"/media/{name}")
    assert refusal.status_code == 404
    assert refusal.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("called", [".webm", ".mov", ".m4v"])
def test_a_video_is_called_what_it_is_and_not_what_its_name_says(
    client: Api, app: AppContext, tmp_path: Path, called: str
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    for video in (folder / "videos").iterdir():
        video.rename(video.with_suffix(called))
    recordings = folder / "recordings.csv"
    recordings.write_text(recordings.read_text().replace(".mp4", called))
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    url = client.start("kettles").to_first_query().state["query"]["left"]["url"]
    assert client.get(url).headers["content-type"] == "video/mp4"


def test_a_video_is_handed_out_without_its_metadata(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    folder = write_own_study(tmp_path / "kettles")
    for video in (folder / "videos").iterdir():
        plain = video.rename(video.with_suffix(".plain"))
        with (
            av.open(plain) as given,
            av.open(video, mode="w", options={"movflags": "+faststart"}) as written,
        ):
            written.metadata.update({"title": "SECRETTITLE method=bo", "comment": "GPSSECRET"})
            stream = written.add_stream_from_template(given.streams.video[0])
            for packet in given.demux(video=0):
                if packet.size:
                    packet.stream = stream
                    written.mux(packet)
        plain.unlink()
        assert b"SECRET" in video.read_bytes()
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    query = client.start("kettles").to_first_query().state["query"]
    for side in ("left", "right"):
        assert b"SECRET" not in client.get(query[side]["url"]).content
    for kept in app.settings.own_videos.glob("*.mp4"):
        assert b"SECRET" not in kept.read_bytes()


def test_a_video_whose_file_has_gone_is_not_found_and_the_session_goes_on(
    client: Api, own_study: StudyInfo, app: AppContext
) -> None:
    session = client.start("kettles").to_first_query()
    for video in app.settings.uploads_dir.iterdir():
        video.unlink()
    refusal = client.get(session.state["query"]["left"]["url"])
    assert refusal.status_code == 404
    assert "missing" in refusal.json()["detail"]
    assert session.look()["stage"] == "query"


def test_creating_a_study_leaves_its_folder_as_it_was_and_needs_it_no_more(
    client: Api, app: AppContext, tmp_path: Path
) -> None:
    folder = write_own_study(tmp_path / "moved")
    before = sorted(path.name for path in folder.rglob("*"))
    repository.create(app, repository.load_folder(str(folder)))
    assert sorted(path.name for path in folder.rglob("*")) == before
    repository.open_study(app, "kettles")
    folder.rename(tmp_path / "elsewhere")
    state = client.start("kettles").to_first_query().state
    assert client.get(state["query"]["right"]["url"]).status_code == 200
