"""The studies that ship are sound, and so is the example that a new study begins from."""

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from app.study import (
    SHIPPED,
    TEXT_NAMES,
    FolderNotEmptyError,
    Plan,
    StudyFaults,
    UnknownStudyError,
    init,
    load,
    render,
    resolve,
)
from app.study.plan_summary import in_words


@pytest.mark.parametrize(
    ("name", "environment", "preset"),
    [("waste-crane", "env1", "paper-env1"), ("waste-crane-env2", "env2", "paper-env2")],
)
def test_a_shipped_study_compares_the_three_methods_as_published(
    name: str, environment: str, preset: str
) -> None:
    plan = load(resolve(name)).plan
    assert plan.slug == name
    label = {
        condition.method: condition.skip and plan.text(condition.skip.label, "en")
        for condition in plan.conditions
    }
    assert label == {
        "pbpo": "I don't like either.",
        "pbpo-no-synthesis": "It's hard to choose.",
        "pbpo-no-skip": None,
    }
    assert {condition.environment for condition in plan.conditions} == {environment}
    assert all(condition.settings == {"preset": preset} for condition in plan.conditions)
    assert plan.environments[environment].is_crane
    assert (plan.trials, plan.queries_per_trial, plan.break_s) == (3, 30, 120)
    assert (plan.familiarisation.videos, plan.familiarisation.required) == (10, 0)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_texts_of_a_shipped_study_render_and_leave_nothing_to_fill_in(name: str) -> None:
    study = load(SHIPPED[name])
    for language in study.plan.languages:
        assert set(study.texts[language]) == set(TEXT_NAMES)
        for text in study.texts[language].values():
            assert render(text).startswith("<h2>")
            assert not re.search(r"\[.*?\]|TODO", text)


def test_the_whole_published_experiment_ships() -> None:
    plan = load(resolve("waste-crane-paper")).plan
    assert Counter(
        (c.environment, c.method, str(c.settings["preset"])) for c in plan.conditions
    ) == {
        (environment, method, f"paper-{environment}"): 1
        for environment in ("env1", "env2")
        for method in ("pbpo", "pbpo-no-synthesis", "pbpo-no-skip")
    }
    assert (plan.trials_per_condition, plan.trials, plan.queries_per_trial) == (3, 18, 30)
    assert (plan.order, plan.blocks, plan.break_s) == ("counterbalanced", "environment", 120)
    assert (plan.familiarisation.videos, plan.familiarisation.required) == (100, 100)
    assert [plan.familiarises_before(trial) for trial in (0, 1, 8, 9, 10)] == [
        True,
        False,
        False,
        True,
        False,
    ]


def test_the_live_study_goes_over_ranges_and_needs_no_videos() -> None:
    study = load(resolve("waste-crane-live"))
    plan = study.plan
    assert study.recordings == ()
    assert plan.environments["env1"].is_crane_machine
    assert [(one.name, one.min, one.max) for one in plan.parameters] == [
        ("w0", 0.0, 1.0),
        ("w1", 0.0, 1.0),
    ]
    assert plan.constraints == ("w0 >= w1",)
    assert [condition.method for condition in plan.conditions] == ["pbpo-threshold"]
    assert plan.familiarisation.videos == 0


def test_the_texts_of_the_live_study_say_the_number_of_its_pairs() -> None:
    texts = load(SHIPPED["waste-crane-live"]).texts
    for name in ("consent", "instructions"):
        assert (
            "There are 30 pairs" in texts["en"][name] or "there are 30 of them" in texts["en"][name]
        )
        assert "30ペア" in texts["ja"][name]


def test_the_study_of_a_crowd_asks_ten_pairs_for_one_model_of_all_people() -> None:
    study = load(SHIPPED["waste-crane-crowd"])
    [condition] = study.plan.conditions
    assert (condition.is_shared, condition.finds) == (True, "population")
    assert (study.plan.trials, study.plan.queries_per_trial) == (1, 10)
    words = " ".join(in_words(study.plan))
    assert "Under together, the answers of all people teach one model" in words
    for name in ("consent", "instructions"):
        english = " ".join(study.texts["en"][name].split())
        assert "10 pairs" in english or "10 of them" in english
        assert "10ペア" in study.texts["ja"][name]
    # Who agrees knows that answers have a part in what others are shown.
    assert "which pairs other people are shown" in " ".join(study.texts["en"]["consent"].split())


PARTS = {
    "waste-crane": ("three parts of 30", "ten videos"),
    "waste-crane-env2": ("three parts of 30", "ten videos"),
    "waste-crane-paper": ("nine parts of 30", "100 videos"),
}


@pytest.mark.parametrize("name", PARTS)
def test_the_texts_of_a_shipped_study_say_the_numbers_of_its_plan(name: str) -> None:
    texts = load(SHIPPED[name]).texts["en"]
    consent, instructions = (" ".join(texts[text].split()) for text in ("consent", "instructions"))
    parts, videos = PARTS[name]
    assert parts in consent
    assert parts in instructions
    assert videos in instructions
    assert "two minutes" in consent


def test_a_study_is_found_by_its_name_or_its_folder(tmp_path: Path) -> None:
    assert resolve("waste-crane") == SHIPPED["waste-crane"]
    assert resolve(str(tmp_path)) == tmp_path


def test_a_study_that_is_neither_is_refused_with_what_there_is() -> None:
    with pytest.raises(UnknownStudyError, match=r"waste-crane, waste-crane-env2.* got 'no-such'"):
        resolve("no-such")


# The example


def test_a_new_study_lacks_nothing_but_its_words_and_its_videos(tmp_path: Path) -> None:
    init(tmp_path / "new" / "study")
    with pytest.raises(StudyFaults) as caught:
        load(tmp_path / "new" / "study")
    videos = [str(f) for f in caught.value.faults if f.file == "recordings.csv"]
    words = [str(f) for f in caught.value.faults if f.file != "recordings.csv"]
    assert len(videos) == 4
    assert all("expected a video, there is no file" in fault for fault in videos)
    assert all("expected words of your own, got the placeholder [" in fault for fault in words)
    assert {f.file.split("/")[0] for f in caught.value.faults} == {"recordings.csv", "texts"}


def test_a_new_study_is_sound_once_its_videos_are_there(
    tmp_path: Path, write_video: Callable[..., None]
) -> None:
    init(tmp_path)
    for shade, name in enumerate(("slow-low", "slow-high", "fast-low-1", "fast-low-2")):
        write_video(tmp_path / "videos" / f"{name}.mp4", 50 * shade)
    for text in (tmp_path / "texts" / "en").iterdir():
        text.write_text(text.read_text(encoding="utf-8").translate({91: None, 93: None}))
    study = load(tmp_path)
    assert len(study.recordings) == 4
    assert len(study.candidates("kitchen")) == 3


def test_the_example_explains_every_key_of_a_plan(tmp_path: Path) -> None:
    init(tmp_path)
    text = (tmp_path / "study.yaml").read_text(encoding="utf-8")
    for key in Plan.model_fields:
        assert re.search(rf"^(# )?{key}:", text, re.MULTILINE), key


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(FolderNotEmptyError, match="expected a new or empty folder"):
        init(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_file_is_no_folder_to_begin_in(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FolderNotEmptyError, match="got the file"):
        init(tmp_path / "file")


def test_a_new_study_with_a_machine_lacks_nothing_but_its_words(tmp_path: Path) -> None:
    init(tmp_path, machine=True)
    with pytest.raises(StudyFaults) as caught:
        load(tmp_path)
    assert {fault.file.split("/")[0] for fault in caught.value.faults} == {"texts"}
    for text in (tmp_path / "texts" / "en").iterdir():
        text.write_text(text.read_text(encoding="utf-8").translate({91: None, 93: None}))
    plan = load(tmp_path).plan
    assert plan.environments["road"].is_machine
    assert plan.space is not None


def test_the_summary_of_a_study_over_ranges_says_its_space_and_how_rollouts_are_asked() -> None:
    words = " ".join(in_words(load(SHIPPED["waste-crane-live"]).plan))
    assert (
        "Candidates are all points of w0 from 0 to 1 s, w1 from 0 to 1 s, where w0 >= w1." in words
    )
    assert "In env1, videos are recorded by the simulated crane while people choose" in words
    assert "at most 1 new candidate in each pair" in words
    assert "Up to 3 rollouts are asked for ahead; each is tried up to 3 times" in words
