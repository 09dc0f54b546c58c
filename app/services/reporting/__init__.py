"""A study's report: one description of typed blocks, written as HTML and as PDF.

`describe` puts the parts together: `design`, `flow`, `outcome`, `reliability`, `versions`.
"""

from .as_html import POLICY, html
from .as_pdf import pdf
from .describe import describe
from .document import Report

__all__ = ["POLICY", "Report", "describe", "html", "pdf"]
