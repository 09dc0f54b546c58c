"""Zips are understood whatever packed them, and what is not used of them is named."""

from __future__ import annotations

import io
import unicodedata
import zipfile
from pathlib import Path

import pytest

from app.services.accounts.accounts import Role
from app.services.context import AppContext

from .client import Api
from .desk import Desk
from .own_study import write_own_study


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = write_own_study(tmp_path_factory.mktemp("zips") / "kettles")
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def desk(client: Api, app: AppContext) -> Desk:
    return Desk(client, app, "mo@lab.example", Role.EXPERIMENTER)


class _InCodePage(zipfile.ZipInfo):
    """An entry whose name is written in a code page, without the mark of UTF-8."""

    def __init__(self, name: str, encoding: str) -> None:
        super().__init__("x")
        self.filename, self._encoded = name, name.encode(encoding)

    def _encodeFilenameFlags(self) -> tuple[bytes, int]:  # noqa: N802 - zipfile calls it so
        return self._encoded, self.flag_bits & ~0x800


def packed(files: dict[str, bytes], encoding: str = "utf-8") -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(_InCodePage(name, encoding), data)
    return content.getvalue()


def renamed(files: dict[str, bytes], name: str, table_form: str = "NFC") -> dict[str, bytes]:
    """The study with a video of this name, which its table has too."""
    made = {name if one == "videos/a.mp4" else one: data for one, data in files.items()}
    cell = unicodedata.normalize("NFD" if table_form == "NFD" else "NFC", name)
    made["recordings.csv"] = files["recordings.csv"].replace(b"videos/a.mp4", cell.encode())
    return made


@pytest.mark.parametrize(
    ("name", "encoding"),
    [
        ("videos/注ぐ 低い.mp4", "cp932"),
        ("videos/Kippen Mühle.mp4", "cp1252"),
        ("videos/Kippen Mühle.mp4", "cp437"),
        ("videos/Kippen Mühle.mp4", "cp850"),
        ("videos/Kippen Mühle.mp4", "utf-8"),
        (unicodedata.normalize("NFD", "videos/Kippen Mühle.mp4"), "utf-8"),
        ("videos/기울기.mp4", "euc-kr"),
    ],
)
@pytest.mark.parametrize("table_form", ["NFC", "NFD"])
def test_names_are_decoded_as_the_table_names_them(
    desk: Desk, files: dict[str, bytes], name: str, encoding: str, table_form: str
) -> None:
    here = desk.begin({"a.zip": packed(renamed(files, name, table_form), encoding)})
    page = desk.get(here).text
    assert "No fault found" in page
    assert unicodedata.normalize("NFC", name) in page


def test_folders_around_the_study_and_other_spellings_of_its_files_are_understood(
    desk: Desk, files: dict[str, bytes]
) -> None:
    around = {f"a\\b\\{name}".replace("/", "\\"): data for name, data in files.items()}
    here = desk.begin({"a.zip": packed(around)})
    assert "No fault found" in desk.get(here).text
    assert desk.post(f"{here}/create").headers["location"] == "/studies/kettles"
    other = {
        name.replace("study.yaml", "Study.yml").replace(
            "texts/en/consent", "Texts/EN/Consent"
        ): data
        for name, data in files.items()
    }
    other["readme/Letter.docx"] = b"x"
    around = {f"kettles/{name}": data for name, data in other.items()} | {"other.txt": b"x"}
    page = desk.get(desk.begin({"a.zip": packed(around)})).text
    assert "kettles/Study.yml is taken as study.yaml" in page
    assert "left out, since they lie outside the study&#39;s folder: other.txt" in page
    assert "Not used by the study: readme/Letter.docx" in page
    # The slug alone is a fault: the first one has it.
    assert "1 fault to put right" in page


def test_two_studies_in_one_zip_are_asked_for(desk: Desk, files: dict[str, bytes]) -> None:
    both = {f"{name}/study.yaml": files["study.yaml"] for name in ("a", "b")}
    answer = desk.send("/drafts", {"a.zip": packed(both)})
    assert answer.status_code == 422
    assert "Expected one study in the zip, got a/study.yaml and b/study.yaml" in answer.text


def test_hidden_files_and_those_of_systems_are_left_out_and_said_to_be(
    desk: Desk, files: dict[str, bytes]
) -> None:
    litter = [".git/config", "videos/.gitkeep", "videos/._a.mp4", "Thumbs.db", "videos/desktop.ini"]
    here = desk.begin({"a.zip": packed(files | dict.fromkeys(litter, b"x"))})
    page = desk.get(here).text
    assert "No fault found" in page
    assert "left out: 5 files, hidden or that a system adds" in page
    sent = desk.send(f"{here}/files", {".DS_Store": b"x", "more.txt": b"x"})
    assert sent.status_code == 303
    assert "left out, since they are hidden or added by a system: .DS_Store" in desk.get(here).text


def test_a_plan_follows_its_table_until_somebody_edits_it(
    desk: Desk, files: dict[str, bytes], tmp_path: Path
) -> None:
    videos = {name: data for name, data in files.items() if name.startswith("videos/")}
    here = desk.begin({Path(name).name: data for name, data in videos.items()}, name="Tilt")

    def plan() -> str:
        return desk.get(f"{here}/text?file=study.yaml").text

    assert "name: speed, label: Tilting speed" in plan()
    table = "\ufeffStärke [N];Dämpfung;Datei;Notiz\r\n"
    rows = [f"0,{n};{n},5;{Path(name).name};gut" for n, name in enumerate(videos, start=1)]
    german = (table + "\r\n".join(rows)).encode("cp1252", "ignore")
    assert desk.send(f"{here}/files", {"Recordings.CSV": german}).status_code == 303
    assert "staerke" in plan()
    assert "Stärke" in plan()
    assert "daempfung" in plan()
    page = desk.get(here).text
    assert "in Windows-1252 with semicolons and decimal commas" in page
    assert "stored as CSV in UTF-8 with commas and decimal points" in page
    assert "the column is left aside: Notiz" in page
    assert "0.1,1.5," in desk.get(f"{here}/text?file=Recordings.csv").text.replace(
        "Recordings.CSV", ""
    )
    # Once somebody edited the parameters, a table changes nothing, and they can be taken.
    edited = plan().split('data-testid="draft-text">')[1].split("</textarea>")[0]
    edited = (
        edited.replace("&#34;", '"').replace("&#39;", "'").replace("&lt;", "<").replace("&gt;", ">")
    )
    edited = (
        edited.replace("&amp;", "&").replace('"staerke"', '"strength"').replace("Stärke", "Force")
    )
    assert desk.post(f"{here}/text", file="study.yaml", text=edited).status_code == 303
    assert "a column strength" in desk.get(here).text
    assert "strength" in plan()
    assert "Take the parameters from the table" in desk.get(here).text
    assert desk.post(f"{here}/parameters").status_code == 303
    assert "staerke" in plan()


def test_slips_of_yaml_are_put_right_by_a_button(desk: Desk, files: dict[str, bytes]) -> None:
    slipped = files["study.yaml"].replace(
        b"contact: Jo, jo@lab.example", b"contact: Jo: jo@lab.example"
    )
    assert slipped != files["study.yaml"]
    here = desk.begin({"a.zip": packed(files | {"study.yaml": slipped})})
    assert "write contact: &#34;Jo: jo@lab.example&#34;" in desk.get(here).text
    assert desk.post(f"{here}/mend").status_code == 303
    assert "No fault found" in desk.get(here).text
