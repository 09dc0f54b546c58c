"""Tables are understood as people save and write them, and what was understood is said."""

from __future__ import annotations

import datetime
import io
import unicodedata
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest
from openpyxl import Workbook

from app.study import workbook
from app.study.folder import examine, load
from app.study.table_headers import parameter_name

Faults = Callable[[Path], list[str]]

PLAIN = """\
speed,height,file,score
0.1,1,videos/a.mp4,-3.5
0.1,1,videos/b.mp4,
0.2,1,videos/c.mp4,-1e1
"""
SEMICOLONS = PLAIN.replace(",", ";").replace(".1", ",1").replace(".2", ",2").replace("3.5", "3,5")


def read(folder: Path, content: bytes, name: str = "recordings.csv") -> str:
    """Write the table, require that it means what the plain one does, and return what is said."""
    expected = load(folder).recordings
    (folder / "recordings.csv").unlink()
    (folder / name).write_bytes(content)
    found = load(folder)
    assert found.recordings == expected
    return " | ".join(str(remark) for remark in found.remarks)


@pytest.mark.parametrize(
    ("text", "encoding", "said"),
    [
        (PLAIN, "utf-8-sig", ""),
        (PLAIN, "utf-16", "in UTF-16"),
        (PLAIN.replace(",", "\t"), "utf-16", "in UTF-16 with tabs"),
        (PLAIN, "utf-16-le", "in UTF-16"),
        (PLAIN, "utf-16-be", "in UTF-16"),
        (PLAIN.replace(",", "\t"), "utf-8", "read as a table with tabs"),
        (PLAIN.replace(",", ";"), "utf-8", "read as a table with semicolons"),
        (SEMICOLONS, "utf-8", "with semicolons and decimal commas"),
        (SEMICOLONS.replace("\n", ";\r\n") + ";;;;\r\n", "utf-8-sig", "decimal commas"),
        (SEMICOLONS.replace("\n", "\r"), "utf-8", "decimal commas"),
        ("sep=;\n" + SEMICOLONS, "utf-8", "with semicolons"),
        ("sep=,\n" + PLAIN, "utf-8", ""),
        ("# exported 2026-03-01, by Jo\n" + PLAIN, "utf-8", "the comment in line 1 is left aside"),
        (PLAIN.replace("0.1", '"0,1"').replace("0.2", '"0,2"'), "utf-8", "decimal commas"),
        (PLAIN.replace("0.2", "\uff10\uff0e\uff12"), "utf-8", "' is read as 0.2"),
        (PLAIN.replace("-3.5", '"-3,5"'), "utf-8", "decimal commas"),
        (PLAIN.replace("-3.5", "\u22123.5"), "utf-8", "is read as -3.5"),
        (PLAIN.replace("speed,height,file", "Speed,HEIGHT,File Name"), "utf-8", ""),
        (PLAIN.replace("speed,height", "speed [m/s],Height (m)"), "utf-8", ""),
        (PLAIN.replace("speed", "speed / (m/s)"), "utf-8", ""),
        (PLAIN.replace("speed,", "speed [cm/s],"), "utf-8", "says cm/s, the plan says m/s"),
        (PLAIN.replace(",file,", ",where it is,"), "utf-8", ""),
        (PLAIN.replace("videos/", "videos\\"), "utf-8", "is taken for the file videos/a.mp4"),
        (PLAIN.replace("videos/", "C:\\Users\\Jo\\videos\\"), "utf-8", "and 2 more so"),
        (PLAIN.replace("videos/", "/home/jo/"), "utf-8", "is taken for"),
        (PLAIN.replace("videos/", ""), "utf-8", "'a.mp4' is taken for the file videos/a.mp4"),
        (PLAIN.replace("videos/a.mp4", "Videos/A.MP4"), "utf-8", "is taken for"),
        (PLAIN.replace(".mp4", ""), "utf-8", "'videos/a' is taken for"),
    ],
)  # fmt: skip
def test_a_table_is_understood_as_it_was_saved(
    folder: Path, text: str, encoding: str, said: str
) -> None:
    remarks = read(folder, text.encode(encoding))
    assert said in remarks
    if not said:
        assert "is read as" not in remarks


def test_columns_that_are_none_of_the_studys_are_left_aside_and_said_to_be(folder: Path) -> None:
    lines = PLAIN.splitlines()
    noted = [f",{lines[0]},notes", *(f"{i},{line},dark" for i, line in enumerate(lines[1:]))]
    said = read(folder, "\n".join(noted).encode())
    assert "the columns are left aside: one without a name, notes" in said


@pytest.mark.parametrize("encoding", ["cp932", "cp1252", "mac-roman", "utf-8"])
@pytest.mark.parametrize(("on_disk", "in_table"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_names_of_files_are_found_in_any_encoding_and_normal_form(
    folder: Path, encoding: str, on_disk: Literal["NFC", "NFD"], in_table: Literal["NFC", "NFD"]
) -> None:
    name = "傾き 低い.mp4" if encoding == "cp932" else "Kippen Mühle.mp4"
    in_table = in_table if encoding == "utf-8" else "NFC"
    file = folder / "videos" / unicodedata.normalize(on_disk, name)
    (folder / "videos" / "a.mp4").rename(file)
    table = PLAIN.replace("a.mp4", unicodedata.normalize(in_table, name))
    (folder / "recordings.csv").write_bytes(table.encode(encoding))
    assert load(folder).recordings[0].file == f"videos/{file.name}"


def test_letters_that_could_be_of_two_encodings_are_asked_for(folder: Path, faults: Faults) -> None:
    (folder / "recordings.csv").write_bytes(
        PLAIN.encode() + b"0.3,1,videos/\x83\x41\xe4\x74.mp4,\n"
    )
    (folder / "recordings.csv").write_bytes(PLAIN.encode() + b"\x81,1,videos/a.mp4,\n")
    [fault] = faults(folder)
    assert fault.startswith("recordings.csv:5: expected text in UTF-8, got the byte 0x81")
    assert "save it as CSV UTF-8" in fault


def test_a_number_that_is_thousands_or_decimals_is_asked_for_in_any_dialect(
    folder: Path, faults: Faults
) -> None:
    text = SEMICOLONS.replace("0,1;1;videos/a", "1.250;1;videos/a")
    (folder / "recordings.csv").write_text(text)
    [fault] = faults(folder)
    assert "got '1.250' (write 1250 or 1.25, whichever is meant)" in fault
    # Beside decimals that can be nothing else, the comma of 1,250 is a decimal mark too.
    (folder / "recordings.csv").write_text(SEMICOLONS.replace("0,1;1;videos/a", "1,250;1;videos/a"))
    assert load(folder).recordings[0].candidate == (1.25, 1.0)


@pytest.mark.parametrize(
    ("cell", "advice"),
    [
        ("01. Feb", "a spreadsheet makes dates of numbers"),
        ("2026-02-01", "a spreadsheet makes dates of numbers"),
        ("1/3", "write it as a decimal number"),
        ("0.2 m/s", "write 0.2, and the unit in the header: speed [m/s]"),
        ("20%", "write 20 or 0.2, whichever is meant"),
    ],
)
def test_a_cell_that_is_no_number_gets_advice(
    folder: Path, faults: Faults, cell: str, advice: str
) -> None:
    (folder / "recordings.csv").write_text(PLAIN.replace("0.2,", f"{cell},"))
    assert advice in faults(folder)[0]


def test_two_files_or_columns_that_can_be_meant_are_asked_for(folder: Path, faults: Faults) -> None:
    (folder / "other").mkdir()
    (folder / "other" / "b.mp4").write_bytes(b"another")
    (folder / "recordings.csv").write_text(PLAIN.replace("videos/b", "b"))
    [fault] = faults(folder)
    assert "expected one file, 'b.mp4' can mean other/b.mp4, videos/b.mp4" in fault
    (folder / "recordings.csv").write_text(PLAIN.replace("speed,height", "Speed,SPEED"))
    assert any(
        "expected one column for speed, got Speed and SPEED" in one for one in faults(folder)
    )


def workbook_of(*sheets: tuple[str, list[list[object]]]) -> bytes:
    book = Workbook()
    book.remove(book.worksheets[0])
    for title, rows in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


ROWS: list[list[object]] = [
    ["Speed [m/s]", "Height", "Video", "Score"],
    [0.1, 1, "videos/a.mp4", -3.5],
    [0.1, 1, "videos/b.mp4", None],
    [],
    [0.2, 1, "videos/c.mp4", -10],
]


@pytest.mark.parametrize("name", ["recordings.xlsx", "recordings.csv", "Recordings.XLSX"])
def test_an_excel_workbook_is_read_whatever_it_is_called(folder: Path, name: str) -> None:
    content = workbook_of(("Notes", [["by Jo"]]), ("Tabelle1", ROWS), ("Leer", []))
    said = read(folder, content, name)
    assert ("Excel workbook" in said) == (name == "recordings.csv")
    assert (f"{name} is read in its place" in said) == (name != "recordings.csv")


def test_two_sheets_that_could_be_meant_and_a_date_of_excel_are_asked_for(
    folder: Path, faults: Faults
) -> None:
    (folder / "recordings.csv").write_bytes(workbook_of(("A", ROWS), ("B", ROWS)))
    assert "expected one sheet with a column for the files, got 2 among A, B" in faults(folder)[0]
    dated = [row[:] for row in ROWS]
    dated[4][0] = datetime.date(2026, 2, 1)
    (folder / "recordings.csv").write_bytes(workbook_of(("A", dated)))
    assert "got '2026-02-01' (a spreadsheet makes dates" in faults(folder)[0]


def test_a_workbook_that_would_grow_without_end_is_refused(
    folder: Path, faults: Faults, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_part(name: str, content: bytes) -> None:
        packed = io.BytesIO(workbook_of(("A", ROWS)))
        with zipfile.ZipFile(packed, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(name, content)
        (folder / "recordings.csv").write_bytes(packed.getvalue())

    with_part("xl/media/a.bin", b"\0" * 5_000_000)
    assert "expected a workbook of at most 50 MB unpacked" in faults(folder)[0]
    with_part("xl/more.xml", b'<!DOCTYPE x [<!ENTITY a "a">]><x/>')
    assert "expected a plain workbook, got one with a document type" in faults(folder)[0]
    monkeypatch.setattr(workbook, "MOST_ROWS", 2)
    (folder / "recordings.csv").write_bytes(workbook_of(("A", ROWS)))
    assert any("two different candidates, got 1" in fault for fault in faults(folder))
    (folder / "recordings.csv").write_bytes(b"\xd0\xcf\x11\xe0" + b"\0" * 100)
    assert "of an older Excel (.xls): save it as .xlsx" in faults(folder)[0]


def test_a_number_with_a_comma_in_a_table_of_commas_is_said_to_need_quotes(
    folder: Path, faults: Faults
) -> None:
    (folder / "recordings.csv").write_text(PLAIN.replace("0.1,1,videos/a", "0,1,1,videos/a"))
    assert faults(folder) == [
        (
            "recordings.csv:2: expected 4 values as in the header, got 5"
            " (a decimal comma needs quotes around the number)"
        )
    ]


def test_files_that_nothing_names_are_named(folder: Path) -> None:
    (folder / "videos" / "more.mp4").write_bytes(b"")
    (folder / "Consent.docx").write_bytes(b"")
    (folder / "README.md").write_text("What this folder is.")
    assert examine(folder).unused == ("Consent.docx", "videos/more.mp4")


@pytest.mark.parametrize(
    ("header", "name"),
    [
        ("Tilt Speed", "tilt_speed"),
        ("Höhe (m)", "hoehe"),
        ("Größe", "groesse"),
        ("傾き [deg]", "parameter"),
        ("2nd joint", "parameter_2nd_joint"),
        ("speed", "speed_2"),
    ],
)
def test_a_header_becomes_the_name_of_a_parameter(header: str, name: str) -> None:
    assert parameter_name(header, {"speed"}) == name
