"""Renders a report as one self-contained HTML file: no scripts, fonts or network requests."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from html import escape

from .document import Block, Figure, Heading, Paragraph, Report, Table

_STYLE = """
:root { color-scheme: light; }
body { max-width: 52rem; margin: 2rem auto; padding: 0 1rem; color: #1c1f24; background: #fff;
  font: 1rem/1.5 system-ui, sans-serif; font-variant-numeric: tabular-nums; }
h1, h2, h3 { line-height: 1.2; }
h2 { margin-top: 2.5rem; border-top: 1px solid #c9cdd3; padding-top: 1rem; }
table { border-collapse: collapse; width: 100%; }
caption { text-align: left; color: #4a505a; padding: .5rem 0; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0;
  border-bottom: 1px solid #e3e6ea; overflow-wrap: anywhere; }
tbody th { font-weight: 400; }
thead th { white-space: nowrap; overflow-wrap: normal; }
.wide { overflow-x: auto; margin: 1rem 0; }
figure { margin: 1rem 0; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #4a505a; }
@media print { body { margin: 0; max-width: none; } figure, tr { break-inside: avoid; } }
"""

#: Content security policy of a report: it loads nothing and runs nothing.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def html(report: Report) -> bytes:
    """The report as HTML in UTF-8. The same report gives the same bytes."""
    title = escape(report.title)
    head = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{title}</h1>\n<p>{escape(report.subtitle)}</p>\n"
    )
    body = "".join(part for block in report.blocks for part in _written(block))
    return f"{head}{body}</main>\n</body>\n</html>\n".encode()


def _written(block: Block) -> Iterator[str]:
    match block:
        case Heading():
            yield f"<h{block.level}>{escape(block.text)}</h{block.level}>\n"
        case Paragraph():
            yield f"<p>{escape(block.text)}</p>\n"
        case Table():
            yield from _table(block)
        case Figure():
            drawing = base64.b64encode(block.drawing.encode("utf-8")).decode("ascii")
            source = f"data:image/svg+xml;base64,{drawing}"
            yield f'<figure><img alt="{escape(block.says)}" src="{source}">'
            yield f"<figcaption>{escape(block.caption)}</figcaption></figure>\n"


def _table(table: Table) -> Iterator[str]:
    caption = escape(table.caption)
    yield f'<div class="wide" tabindex="0" role="region" aria-label="{caption}"><table>\n'
    yield f"<caption>{caption}</caption>\n<thead><tr>"
    yield from (f'<th scope="col">{escape(name)}</th>' for name in table.header)
    yield "</tr></thead>\n<tbody>\n"
    for first, *others in table.rows:
        cells = "".join(f"<td>{escape(value)}</td>" for value in others)
        yield f'<tr><th scope="row">{escape(first)}</th>{cells}</tr>\n'
    yield "</tbody></table></div>\n"
