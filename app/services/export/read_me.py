"""The README of exported tables: how pandas, R and Excel read them without changing a value."""

from __future__ import annotations

from .filters import in_words
from .table import Request

_TEXT = """\
# {title}

Tables of the study `{slug}`. Every column of every file is described in `data_dictionary.csv`.
Tables are joined by `session_id`, and with `trial_index` and `query_index` where they have them.
Included: {included}.

The files are UTF-8 with commas, and times are UTC. An empty cell is a missing value; answers of
people such as `None` or `NA` are text. One line reads a table so:

    pandas:  pd.read_csv("queries.csv", keep_default_na=False, na_values=[""])
    R:       read.csv("queries.csv", na.strings = "", fileEncoding = "UTF-8{bom}")
    Excel:   {excel}

A cell that begins with `=`, `+`, `-` or `@` and is no number has a `'` before it, so that no
spreadsheet runs it.
"""


def text(request: Request) -> str:
    """The README as Markdown."""
    plan = request.study.plan
    return _TEXT.format(
        title=plan.text(plan.title, plan.default_language),
        slug=request.study.slug,
        included=in_words(request),
        bom="-BOM" if request.excel else "",
        excel="open the file: it begins with a byte order mark"
        if request.excel
        else "export with `--excel` (or its box on the page), which adds a byte order mark",
    )
