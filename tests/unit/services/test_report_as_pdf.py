"""A report as PDF, whatever letters it has."""

from __future__ import annotations

import pytest
import typst

from app.services.reporting import as_pdf
from app.services.reporting.document import Heading, Paragraph, Report, Table
from app.services.runtime.errors import PdfError

#: A letter of no script, so that no font has it.
NO_FONT = "\U000e7a3c"


def test_letters_without_a_font_stand_as_their_code() -> None:
    blocks = (Heading(f"Speed {NO_FONT}"), Table("Rows", ("a",), [(f"{NO_FONT} ü",)]))
    made = as_pdf.pdf(Report(f"Cups {NO_FONT}", "2026", blocks))
    assert made.startswith(b"%PDF-")
    assert as_pdf.pdf(Report("Cups", "2026", (Paragraph("水"),))).startswith(b"%PDF-")


def test_another_fault_of_the_pdf_is_an_error_that_names_the_html(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_report: Report) -> bytes:
        raise typst.TypstError("no space left")  # type: ignore[call-arg]

    monkeypatch.setattr(as_pdf, "_compiled", refuse)
    with pytest.raises(PdfError, match=r"no space left; its HTML can be had"):
        as_pdf.pdf(Report("Cups", "2026", ()))
