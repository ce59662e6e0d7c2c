"""Text in the cells of CSV files, which spreadsheets take for a formula where it begins like one.

An apostrophe in front makes it text there (OWASP, CSV Injection). Figures need none: ``-0.3`` is a number to all.
"""

from __future__ import annotations

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


def cell(text: str) -> str:
    """``text`` so that no spreadsheet computes it; ``text_of`` gives it back."""
    return f"'{text}" if text.lstrip("'").startswith(_FORMULA_STARTS) else text


def text_of(written: str) -> str:
    """The text that ``cell`` wrote."""
    return written[1:] if written.startswith("'") and written.lstrip("'").startswith(_FORMULA_STARTS) else written
