"""What experimenters and whoever runs a studio do, where its recordings are in a store."""

from __future__ import annotations

import json
import re
import time
import zipfile
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

import pytest

from app.crane import library
from app.services.bootstrap import open_app
from app.services.context import AppContext
from app.services.maintenance import backups
from app.services.monitoring import startup_checks
from app.services.recordings.recordings import (
    FILE,
    FoundSource,
    Recordings,
    crane_locator,
    keep_rendered,
    make_video,
)
from app.services.recordings.stores import s3, s3_client
from app.services.recordings.stores.factory import open_stores
from app.services.recordings.stores.interface import SignedUrl
from app.services.runtime.errors import ConflictError, StoreAwayError
from app.services.runtime.settings import Settings
from app.services.studies import folder_export, lifecycle, repository
from app.services.studies.repository import StudyInfo
from tests.conftest import STARTED, Idle
from tests.s3_server import BUCKET, KEY, SECRET, S3Server

from .client import Api
from .own_store import begin_anew, folder, own_study, running, settings, store
from .own_study import frames

__all__ = ["folder", "own_study", "running", "settings", "store"]

T = TypeVar("T")


class AtOnce(Idle):
    """Background work that is done at once, but for videos: `made` are those it was asked for."""

    def __init__(self) -> None:
        super().__init__(1)
        self.made: list[Hashable] = []

    def in_thread(self, key: Hashable, function: Callable[..., T], *args: Any) -> Future[T]:
        function(*args)
        return Future()

    def in_process(
        self, key: Hashable, function: Callable[..., T], *args: Any, urgent: bool = False
    ) -> Future[T]:
        self.made.append(key)
        return Future()


def test_a_rendered_video_is_put_into_the_store_by_whoever_made_it(
    app: AppContext, store: S3Server
) -> None:
    locator = crane_locator("env1", 0, 0)
    made = make_video(app.settings, locator)
    (key,) = store.names()
    # By its content: neither the environment nor the candidate is in the name.
    assert re.fullmatch(r"lab/one/media/[0-9a-f]{32}\.mp4", key)
    assert store.read(key) == made.read_bytes()
    source = FoundSource("crane", locator)
    assert app.recordings.ensure(source).done()
    assert app.recordings.sizes([source]) == {locator: made.stat().st_size}


def test_a_copy_of_a_study_has_its_videos(
    app: AppContext, own_study: StudyInfo, folder: Path, tmp_path: Path
) -> None:
    folder_export.write_folder(app, "kettles", tmp_path / "copy", "copied")
    for video in (folder / "videos").iterdir():
        assert frames(tmp_path / "copy" / "videos" / video.name) == frames(video)


def test_what_is_deleted_goes_from_the_store_and_nothing_beside_it(
    app: AppContext, own_study: StudyInfo, store: S3Server
) -> None:
    name = store.names()[0].rpartition("/")[2]
    beside = [f"lab/{name}", f"lab/one/media/{name}", f"uploads/{name}"]
    for key in beside:
        store.client.put_object(Bucket=BUCKET, Key=key, Body=b"another's")
    repository.close_study(app, "kettles")
    lifecycle.delete(app, "kettles", typed="kettles")
    assert sorted(store.names()) == sorted(beside)
    with pytest.raises(ValueError, match="expected the name of a file"):
        app.recordings.delete(["../../uploads/" + name])


def test_a_store_that_refuses_is_said_without_its_keys(
    client: Api,
    app: AppContext,
    store: S3Server,
    settings: Settings,
    caplog: pytest.LogCaptureFixture,
) -> None:
    elsewhere = settings.model_copy(update={"recordings_url": "s3://another-bucket"})
    object.__setattr__(app, "settings", elsewhere)
    begin_anew(app)
    (fault,) = client.get("/readyz").json()["faults"]
    assert fault == "The store of recordings refuses: NoSuchBucket."
    assert "NoSuchBucket" in caplog.text
    assert not [secret for secret in (KEY, SECRET, "Signature") if secret in caplog.text]


def test_without_keys_a_studio_is_not_opened(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    with pytest.raises(ConflictError, match="expected credentials"):
        open_stores(settings)


def test_a_video_is_made_ahead_only_if_the_store_lacks_it(
    app: AppContext, store: S3Server, tmp_path: Path
) -> None:
    source = FoundSource("crane", crane_locator("env1", 0, 1))
    background = AtOnce()
    recordings = Recordings(app.database, background, app.settings)
    recordings.prefetch(source)
    assert background.made == [("render", "env1/0/1")]
    recordings.close()

    name = library.video_name("env1", 0, 1)
    (tmp_path / name).write_bytes(b"rendered elsewhere")
    keep_rendered(app.settings, tmp_path)
    assert store.names() == [f"lab/one/media/{name}"]
    recordings = Recordings(app.database, background, app.settings)
    recordings.prefetch(source)
    assert len(background.made) == 1
    recordings.close()


def test_many_videos_are_looked_up_by_one_list(
    app: AppContext, own_study: StudyInfo, store: S3Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(s3, "PAGE", 3)
    names = [key.rpartition("/")[2] for key in store.names()]
    begin_anew(app)
    store.asked.clear()
    missing = [f"{number:064}.mp4" for number in range(20)]
    found = app.recordings.sizes(FoundSource(FILE, name) for name in [*missing, *names])
    assert set(found) == set(names)
    assert store.asked == [f"GET /{BUCKET}"] * 2


def test_pictures_of_pages_have_the_videos_for_as_long_as_they_take(
    app: AppContext, own_study: StudyInfo, store: S3Server
) -> None:
    name = store.names()[0].rpartition("/")[2]
    there, gone = FoundSource(FILE, name), FoundSource(FILE, f"{'0' * 64}.mp4")
    with app.recordings.files([gone, there]) as files:
        assert [file.read_bytes() for file in files] == [store.read(store.names()[0])]
    assert not files[0].exists()


@pytest.mark.sqlite
def test_a_backup_names_the_videos_in_the_store_and_a_restore_says_what_is_missing(
    app: AppContext, own_study: StudyInfo, store: S3Server, tmp_path: Path
) -> None:
    target = tmp_path / "backup.zip"
    held = backups.backup(app.settings, target, STARTED)
    assert (held.store, held.elsewhere, held.files) == (f"s3://{BUCKET}/lab/one", 4, 0)
    names = {key.rpartition("/")[2] for key in store.names()}
    with zipfile.ZipFile(target) as archive:
        assert set(json.loads(archive.read("manifest.json"))["elsewhere"]["files"]) == names

    for missing in (0, 1):
        new = app.settings.model_copy(update={"data_dir": tmp_path / f"new-{missing}"})
        assert backups.restore(target, new, [], STARTED).missing == missing
        store.client.delete_object(Bucket=BUCKET, Key=store.names()[0])


@pytest.mark.sqlite
@pytest.mark.parametrize("deleted_since", [False, True])
def test_videos_of_a_backup_are_put_into_the_store_unless_their_study_was_deleted(
    settings: Settings, folder: Path, store: S3Server, tmp_path: Path, deleted_since: bool
) -> None:
    in_a_folder = settings.model_copy(update={"recordings_url": ""})
    app = open_app(in_a_folder, background=Idle(1))
    repository.create(app, repository.load_folder(str(folder)))
    repository.open_study(app, "kettles")
    repository.close_study(app, "kettles")
    held = backups.backup(in_a_folder, tmp_path / "backup.zip", STARTED)
    assert (held.store, held.elsewhere, held.files) == ("", 0, 4)
    ledgers = []
    if deleted_since:
        lifecycle.delete(app, "kettles", typed="kettles")
        ledgers = [in_a_folder.deletion_log_path]
    app.close()

    new = settings.model_copy(update={"data_dir": tmp_path / "new"})
    restored = backups.restore(tmp_path / "backup.zip", new, ledgers, STARTED)
    assert (restored.missing, restored.deleted_again) == (0, int(deleted_since))
    assert len(store.names()) == (0 if deleted_since else 4)
    assert list(new.uploads_dir.iterdir()) == []


def test_a_store_that_was_away_is_asked_again_after_a_while(
    app: AppContext, store: S3Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(s3_client, "AWAY_S", 1.5)
    store.stop()
    try:
        assert app.recordings.fault() is not None
    finally:
        store.start()
    store.asked.clear()
    assert app.recordings.fault() is not None
    assert store.asked == []
    time.sleep(1.6)
    assert app.recordings.fault() is None
    assert app.recordings.fault() is None
    assert len(store.asked) == 2


def test_a_video_that_another_process_has_thrown_away_is_kept_anew(
    app: AppContext, store: S3Server, folder: Path
) -> None:
    videos = {f"{'a' * 64}.mp4": folder / "videos" / "a.mp4"}
    app.recordings.keep_files(videos)
    elsewhere = Recordings(app.database, app.background, app.settings)
    elsewhere.delete(videos)
    elsewhere.close()
    assert store.names() == []
    app.recordings.keep_files(videos)
    assert len(store.names()) == 1


def test_no_study_is_made_while_its_videos_cannot_be_kept(
    app: AppContext, folder: Path, store: S3Server
) -> None:
    store.stop()
    try:
        with pytest.raises(StoreAwayError, match="cannot be reached"):
            repository.create(app, repository.load_folder(str(folder)))
    finally:
        store.start()
    assert repository.all_studies(app) == []


@pytest.mark.parametrize(
    ("changes", "site"),
    [
        ({"s3_public_endpoint": "https://s3.lab.example"}, "https://s3.lab.example"),
        ({"s3_endpoint": ""}, f"https://{BUCKET}.s3.eu-central-1.amazonaws.com"),
    ],
)
def test_links_lead_to_the_site_that_pages_may_load_from(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, changes: dict[str, str], site: str
) -> None:
    monkeypatch.setenv("AWS_DEFAULT_REGION", "eu-central-1")
    stores = open_stores(settings.model_copy(update=changes))
    assert stores.own.origin == stores.rendered.origin == site
    place = stores.own.serve("a.webm", head=False)
    assert isinstance(place, SignedUrl)
    assert place.url.startswith(f"{site}/")
    assert "video/webm" in unquote(place.url)
    stores.own.close()


def test_in_production_links_over_plain_http_are_refused(app: AppContext, store: S3Server) -> None:
    assert "PBPO_S3_ENDPOINT" not in " ".join(startup_checks.unsafe_settings(app, "::1"))
    object.__setattr__(app, "settings", app.settings.model_copy(update={"production": True}))
    assert "PBPO_S3_ENDPOINT" in " ".join(startup_checks.unsafe_settings(app, "::1"))
