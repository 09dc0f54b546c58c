"""PBPO Studio: human evaluation studies by pairwise video choices."""

__version__ = "0.1.0"
