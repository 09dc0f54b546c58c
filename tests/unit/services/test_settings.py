"""What can be set from outside."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from app.services.runtime.settings import Settings, settings_faults


def test_the_database_is_a_file_in_the_data_folder_unless_another_is_named(tmp_path: Path) -> None:
    assert Settings(data_dir=tmp_path).url == f"sqlite:///{tmp_path}/pbpo.sqlite3"
    url = "postgresql://lab@db.example/pbpo"
    assert Settings(data_dir=tmp_path, database_url=url).url == url


def test_variables_of_the_environment_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PBPO_DATA_DIR", "elsewhere")
    monkeypatch.setenv("PBPO_SECURE_COOKIES", "1")
    settings = Settings()
    assert settings.data_dir == Path("elsewhere")
    assert settings.secure_cookies
    assert settings.uploads_dir == Path("elsewhere/uploads")


@pytest.mark.parametrize("url", ["nonsense", "mysql://lab@db.example/pbpo", "://"])
def test_a_database_of_another_kind_is_refused_without_repeating_its_password(url: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings(database_url=url)
    said = settings_faults(refused.value)
    assert said.startswith("PBPO_DATABASE_URL: ")
    assert "sqlite or postgresql" in said
    assert url not in said


def test_all_faults_are_named_in_one_line() -> None:
    with pytest.raises(ValidationError) as refused:
        Settings.model_validate({"render_jobs": 0, "database_url": "nonsense"})
    said = settings_faults(refused.value)
    assert "PBPO_RENDER_JOBS" in said
    assert "PBPO_DATABASE_URL" in said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("recordings_url", "https://s3.lab.example/bucket"),
        ("recordings_url", "s3://"),
        ("recordings_url", "s3://key:secret@bucket/prefix"),
        ("recordings_url", "s3://bucket/prefix?region=eu"),
        ("s3_endpoint", "s3.lab.example"),
        ("s3_public_endpoint", "https://key:secret@s3.lab.example"),
        ("s3_endpoint", "https://s3.lab.example/bucket"),
    ],
)
def test_a_store_is_named_without_keys_and_none_is_repeated(name: str, value: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings.model_validate({name: value})
    said = settings_faults(refused.value)
    assert said.startswith(f"PBPO_{name.upper()}: ")
    assert "without keys" in said
    assert "secret" not in said


def test_a_store_may_have_a_prefix_of_several_parts() -> None:
    for url in ("s3://bucket", "s3://bucket.lab-1/", "s3://bucket/studies/2026_a.b"):
        assert Settings(recordings_url=url).recordings_url == url
    assert Settings(s3_endpoint="http://127.0.0.1:9000").s3_endpoint.endswith(":9000")


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({}, "expected PBPO_OWN_VIDEOS_DIR and PBPO_MEDIA_DIR"),
        ({"own_videos_dir": "own", "media_dir": "data/media"}, "apart from data"),
        ({"own_videos_dir": "own", "recordings_url": "s3://bucket"}, "got PBPO_RECORDINGS_URL"),
    ],
)
def test_a_proxy_sends_videos_of_folders_without_answers_alone(
    said: dict[str, str], expected: str
) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings.model_validate({"proxy_sends_videos": True, **said})
    assert settings_faults(refused.value).startswith("PBPO_PROXY_SENDS_VIDEOS: ")
    assert expected in settings_faults(refused.value)


@pytest.mark.parametrize("folder", ["data", "data/uploads", ".", "elsewhere/../data/own"])
def test_own_videos_lie_apart_from_the_answers_or_where_they_always_do(folder: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings(own_videos_dir=Path(folder))
    assert f"expected a folder apart from data, which has the answers, got {Path(folder)}" in (
        settings_faults(refused.value)
    )
    assert Settings().own_videos == Path("data/uploads")
    assert Settings(own_videos_dir=Path("own")).own_videos == Path("own")


@pytest.mark.parametrize(
    ("path", "repair"),
    [
        ("pbpo", "set /pbpo"),
        ("/pbpo/", "set /pbpo"),
        ("/lab//pbpo", "set /lab/pbpo"),
        ("https://lab.example/pbpo", "set /pbpo"),
        ("/", "slash"),
        ("/../pbpo", "slash"),
        ("/a b", "slash"),
        ("/pbpo?x=1", "set /pbpo"),
    ],
)
def test_a_path_that_is_none_is_refused_with_its_repair(path: str, repair: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings(root_path=path)
    said = settings_faults(refused.value)
    assert said.startswith("PBPO_ROOT_PATH: expected a path such as /pbpo")
    assert repair in said
    assert path in said


def test_public_links_begin_with_the_path() -> None:
    said = Settings(root_path="/lab/pbpo", public_url="https://lab.example/")
    assert said.public_base == "https://lab.example/lab/pbpo"
    assert Settings(root_path="/pbpo").public_base == ""
    with pytest.raises(ValidationError, match="PBPO_ROOT_PATH"):
        Settings(public_url="https://lab.example/pbpo")
