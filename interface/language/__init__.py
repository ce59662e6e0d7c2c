"""What people read in other languages than English: one catalogue for both processes.

The code writes English. Where a sentence reaches a person (terminal, dialog, log, report) it is looked up in the
catalogue of the language, a gettext PO file next to this module. Records such as run.json stay in English.
"""

from .catalogue import read_catalogue
from .languages import (
    AUTOMATIC,
    ENGLISH,
    LANGUAGE_VARIABLE,
    LANGUAGES,
    current_language,
    language_of,
    language_of_environment,
    translator,
)
from .translator import Translator

__all__ = [
    "AUTOMATIC",
    "ENGLISH",
    "LANGUAGES",
    "LANGUAGE_VARIABLE",
    "Translator",
    "current_language",
    "language_of",
    "language_of_environment",
    "read_catalogue",
    "translator",
]
