"""Faults in study.yaml and in the texts are named with their file and line."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from app.study import Fault, Plan, StudyFaults, load

Edit = Callable[[Path, str, str], None]
Faults = Callable[[Path], list[str]]

# Faults in study.yaml


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "queries_per_trial: 4",
            "queries_per_trial: 0",
            "study.yaml:19: queries_per_trial: expected a whole number from 1 to 1000, got 0",
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: many",
            "study.yaml:19: queries_per_trial: expected a whole number from 1 to 1000, got 'many'",
        ),
        (
            "queries_per_trial: 4\n",
            "",
            (
                "study.yaml:1: queries_per_trial: expected a whole number from 1 to 1000,"
                " got no such key"
            ),
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nbreak: 3",
            "study.yaml:20: break: unknown key, expected one of "
            + ", ".join(Plan.model_fields)
            + " (did you mean break_s?)",
        ),
        (
            "skip: {label: Neither}",
            "skip: {label: Neither, labels: Both}",
            (
                "study.yaml:14: conditions[0].skip.labels: unknown key, expected one of label,"
                " reasons, means (did you mean label?)"
            ),
        ),
        (
            "skip: {label: Neither}",
            "skip: {label: Neither}\n    model: shared",
            (
                "study.yaml:15: conditions[0].model: expected method pbpo-threshold for a shared"
                " model, got 'pbpo'"
            ),
        ),
        (
            "skip: {label: Neither}",
            "skip: {label: Neither}\n    model: everybody",
            (
                "study.yaml:15: conditions[0].model: expected own or shared: whether the answers"
                " of all people teach one model, got 'everybody'"
            ),
        ),
        (
            "skip: {label: Neither}",
            "skip: {label: Neither}\n    for: person",
            (
                "study.yaml:15: conditions[0].for: expected model: shared with it, since an own"
                " model is for its person, got none"
            ),
        ),
        (
            "skip: {label: Neither}",
            "skip: {label: Neither}\n    model: shared\n    for: everybody",
            (
                "study.yaml:16: conditions[0].for: expected population or person: whose best a"
                " shared model looks for, got 'everybody'"
            ),
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nanalysis: {primary: [soft, with skip]}",
            (
                "study.yaml:20: analysis.primary[0]: expected one of the conditions"
                " (with skip, without skip), got 'soft'"
            ),
        ),
        (
            "method: pbpo\n",
            "method: pppo\n",
            (
                "study.yaml:12: conditions[0].method: expected one of pbpo, pbpo-no-synthesis,"
                " pbpo-no-skip, knockout, pbpo-threshold, got 'pppo'"
            ),
        ),
        (
            "    skip: {label: Neither}\n",
            "",
            (
                "study.yaml:11: conditions[0].skip: expected a skip button's label for method pbpo,"
                " got none"
            ),
        ),
        (
            "{label: Neither}",
            "{label: Neither, means: cannot_tell}",
            (
                "study.yaml:14: conditions[0].skip.means: expected no meaning under pbpo, where a"
                " skip says that both are bad; pbpo-threshold learns either"
            ),
        ),
        (
            "{label: Neither}",
            "{label: Neither, means: whatever}",
            (
                "study.yaml:14: conditions[0].skip.means: expected both_bad or cannot_tell: what a"
                " skip without one of these reasons says, got 'whatever'"
            ),
        ),
        (
            "method: pbpo-no-skip\n",
            "method: pbpo-no-skip\n    skip: {label: Neither}\n",
            (
                "study.yaml:18: conditions[1].skip: expected no skip button for method"
                " pbpo-no-skip, got one"
            ),
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nreward: {amount: 0, currency: EUR}",
            "study.yaml:20: reward.amount: expected an amount above 0 such as 4.5, got 0",
        ),
        (
            "queries_per_trial: 4",
            "queries_per_trial: 4\nreward: {amount: 4.5, currency: €}",
            (
                "study.yaml:20: reward.currency: expected a code of three capital letters"
                " such as EUR, got '€'"
            ),
        ),
        (
            "{label: Neither}",
            "{label: no}",
            (
                "study.yaml:14: conditions[0].skip.label: expected a text, or one text per language"
                " such as {en: ..., ja: ...}, got false (YAML reads no, off and false so: put"
                " quotes around the word if you mean it as a text)"
            ),
        ),
        (
            "name: without skip",
            "name: with skip",
            (
                "study.yaml:16: conditions[1].name: expected each once, got 'with skip' again"
                " (as at conditions[0])"
            ),
        ),
        (
            "name: height",
            "name: speed",
            (
                "study.yaml:7: parameters[1].name: expected each once, got 'speed' again"
                " (as at parameters[0])"
            ),
        ),
        (
            "parameters:\n",
            "parameters:\n  - 3\n",
            (
                "study.yaml:6: parameters[0]: expected an entry of a list of parameters"
                " such as {name: speed, unit: m/s}, got 3"
            ),
        ),
        (
            "environments:\n",
            "environments:\n  Lab 1: {source: crane}\n",
            (
                "study.yaml:9: environments.Lab 1: expected a mapping of lower-case names to"
                " environments such as {kitchen: {source: recordings.csv}}, got the name 'Lab 1'"
            ),
        ),
        (
            "{source: recordings.csv}",
            "{source: ../recordings.csv}",
            (
                "study.yaml:9: environments.kitchen.source: expected a path inside the study"
                " folder, got '../recordings.csv'"
            ),
        ),
        (
            "title: Kettles",
            "title: Kettles: hot",
            'study.yaml:3: expected quotes around the text: write title: "Kettles: hot"',
        ),
        (
            "title: Kettles",
            "title: Kettles\nslug: pots",
            "study.yaml:4: slug: expected each key once, got it again (first in line 2)",
        ),
    ],
)
def test_a_fault_in_the_plan_is_named_with_its_line(
    folder: Path, edit: Edit, faults: Faults, old: str, new: str, expected: str
) -> None:
    edit(folder / "study.yaml", old, new)
    assert expected in faults(folder)


@pytest.mark.parametrize("environment", ["lab", "Kitchen"])
def test_an_unknown_environment_is_named_with_those_there_are(
    folder: Path, edit: Edit, faults: Faults, environment: str
) -> None:
    edit(
        folder / "study.yaml",
        "environment: kitchen\n    skip",
        f"environment: {environment}\n    skip",
    )
    assert faults(folder) == [
        (
            "study.yaml:13: conditions[0].environment: expected one of the environments (kitchen),"
            f" got {environment!r}"
        )
    ]


def test_settings_that_the_optimiser_refuses_are_named_with_their_line(folder: Path) -> None:
    def check(settings: Mapping[str, object]) -> str | None:
        return f"expected other settings, got {settings}" if settings else None

    with pytest.raises(StudyFaults) as caught:
        load(folder, settings_check=check)
    message = "conditions[0].settings: expected other settings, got {'preset': 'paper-env1'}"
    assert caught.value.faults == (Fault("study.yaml", 15, message),)


def test_text_in_another_encoding_is_named_with_its_line(folder: Path, faults: Faults) -> None:
    (folder / "study.yaml").write_bytes("version: 1\ntitle: Töpfe\n".encode("latin-1"))
    assert faults(folder) == ["study.yaml:2: expected text in UTF-8, got the byte 0xf6"]


def test_a_folder_without_a_study_says_so(tmp_path: Path, faults: Faults) -> None:
    missing = ["study.yaml: expected a file of this name, there is none"]
    assert faults(tmp_path) == missing
    assert faults(tmp_path / "nowhere") == missing


# Faults in texts


def test_missing_and_empty_texts_are_named_in_every_language(
    folder: Path, edit: Edit, faults: Faults, write_texts: Callable[[Path, str], None]
) -> None:
    edit(folder / "study.yaml", "languages: [en]", "languages: [en, ja]")
    edit(folder / "study.yaml", "title: Kettles", "title: {en: Kettles, ja: やかん}")
    edit(folder / "study.yaml", "label: Neither", "label: {en: Neither, ja: どちらも}")
    write_texts(folder, "ja")
    assert faults(folder) == []

    (folder / "texts" / "ja" / "consent.md").unlink()
    (folder / "texts" / "en" / "debrief.md").write_text(" \n\n")
    assert faults(folder) == [
        "texts/en/debrief.md: expected some text, got an empty file",
        "texts/ja/consent.md: expected a file of this name, there is none",
    ]


def test_what_people_read_is_needed_in_every_language(
    folder: Path, edit: Edit, faults: Faults, write_texts: Callable[[Path, str], None]
) -> None:
    edit(folder / "study.yaml", "languages: [en]", "languages: [en, ja]")
    write_texts(folder, "ja")
    assert faults(folder) == [
        "study.yaml:3: title: expected a text in every language, got none in ja",
        (
            "study.yaml:14: conditions[0].skip.label: expected a text in every language,"
            " got none in ja"
        ),
    ]


# All at once


def test_all_faults_of_all_files_come_at_once(folder: Path, edit: Edit, faults: Faults) -> None:
    yaml, table = folder / "study.yaml", folder / "recordings.csv"
    edit(yaml, "queries_per_trial: 4", "queries_per_trial: 0")
    edit(yaml, "title: Kettles", "titel: Kettles")
    edit(yaml, "    skip: {label: Neither}\n", "")
    edit(yaml, "method: pbpo-no-skip", "method: best")
    (folder / "texts" / "en" / "instructions.md").unlink()
    edit(table, "0.2,1,videos/c.mp4", "x,1,videos/z.mp4")
    edit(table, "videos/b.mp4", "videos/a.mp4")
    found = faults(folder)
    assert [fault.split(": ")[0] + " " + fault.split(": ")[1] for fault in found] == [
        "study.yaml:1 title",
        "study.yaml:3 titel",
        "study.yaml:11 conditions[0].skip",
        "study.yaml:16 conditions[1].method",
        "study.yaml:18 queries_per_trial",
        "texts/en/instructions.md expected a file of this name, there is none",
        "recordings.csv:3 file",
        "recordings.csv:4 speed",
        "recordings.csv:4 file",
        "recordings.csv expected at least two different candidates, got 1",
    ]


@pytest.mark.parametrize(
    "broken",
    ["parameters: 3", "parameters:\n  - 3\n  - {name: 4}", "parameters: {name: speed}"],
)
def test_recordings_are_checked_even_where_the_parameters_are_unknown(
    folder: Path, edit: Edit, faults: Faults, broken: str
) -> None:
    edit(
        folder / "study.yaml",
        "parameters:\n  - {name: speed, label: Speed, unit: m/s}\n  - {name: height}",
        broken,
    )
    edit(folder / "recordings.csv", "videos/b.mp4", "videos/z.mp4")
    found = faults(folder)
    assert any(fault.startswith("study.yaml:5: parameters") for fault in found) or any(
        fault.startswith("study.yaml:6: parameters") for fault in found
    )
    assert found[-1].startswith("recordings.csv:3: file: expected a video, there is no file")


@pytest.mark.parametrize(
    "text",
    [
        "languages: 3\nenvironments: 3\nconditions: 3\nfamiliarisation: 3\ntitle: 3\n",
        "languages: {a: 1}\nenvironments: [1]\nconditions: {a: {b: 1}}\nparameters: [[1], null]\n",
        "environments: {a: 1, b: {source: [1]}}\nconditions: [{skip: 1, settings: 2}, null]\n",
        "languages: [[1], {a: 1}, null]\ntitle: {en: {a: b}}\nfamiliarisation: {videos: x}\n",
    ],
)
def test_nonsense_in_any_place_is_named_and_never_breaks_the_check(
    folder: Path, faults: Faults, text: str
) -> None:
    (folder / "study.yaml").write_text(text)
    found = faults(folder)
    assert len(found) >= 5
    assert all(fault.startswith("study.yaml:") for fault in found)


@pytest.mark.parametrize("policy", ["restart", "block"])
def test_a_policy_for_those_who_come_late_needs_to_know_when_it_is_late(
    folder: Path, edit: Edit, faults: Faults, policy: str
) -> None:
    rule = f"queries_per_trial: 4\nresume: {{policy: {policy}}}"
    edit(folder / "study.yaml", "queries_per_trial: 4", rule)
    assert faults(folder) == [
        (
            "study.yaml:20: resume.max_age_hours: expected a number of hours after which policy"
            f" {policy} holds, got none"
        )
    ]


def test_a_welcome_in_one_language_is_needed_in_every_language(
    folder: Path, edit: Edit, faults: Faults, write_texts: Callable[[Path, str], None]
) -> None:
    edit(folder / "study.yaml", "languages: [en]", "languages: [en, ja]")
    edit(folder / "study.yaml", "title: Kettles", "title: {en: Kettles, ja: やかん}")
    edit(folder / "study.yaml", "label: Neither", "label: {en: Neither, ja: どちらも}")
    write_texts(folder, "ja")
    (folder / "texts" / "ja" / "welcome.md").write_text("ようこそ\n", encoding="utf-8")
    assert faults(folder) == [
        "texts/en/welcome.md: expected a file of this name, there is none",
    ]
