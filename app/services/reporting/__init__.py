"""A study's report: a sequence of typed blocks, rendered as HTML and as PDF.

`describe` assembles the parts: `design`, `participant_flow`, `results_section`, `reliability`,
`versions`.
"""

from .as_html import POLICY, html
from .as_pdf import pdf
from .describe import describe
from .document import Report

__all__ = ["POLICY", "Report", "describe", "html", "pdf"]
