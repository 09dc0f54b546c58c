"""Tables with more faults or columns than anybody would read."""

from __future__ import annotations

from pathlib import Path

from app.study.recordings import MOST_COLUMNS, MOST_FAULTS, ParameterColumn, RecordingsReader
from app.study.validation_errors import Fault
from app.video.decoder_client import Decoder


def faults(folder: Path, table: str) -> list[Fault]:
    (folder / "recordings.csv").write_text(table)
    with Decoder() as decoder:
        reader = RecordingsReader(folder, decoder)
        reader.read("kitchen", "recordings.csv", [ParameterColumn("speed")])
    return reader.faults


def test_a_table_is_checked_up_to_so_many_faults(tmp_path: Path) -> None:
    found = faults(tmp_path, "speed,file\n" + "fast,missing.mp4\n" * 5_000)
    assert MOST_FAULTS <= len(found) <= MOST_FAULTS + 3
    assert "not checked yet" in found[-1].message


def test_a_header_of_very_many_columns_is_one_fault(tmp_path: Path) -> None:
    header = ",".join(f"c{number}" for number in range(5_000))
    (fault,) = faults(tmp_path, f"{header}\n1\n")
    assert fault.message == f"expected at most {MOST_COLUMNS} columns, got 5000"
