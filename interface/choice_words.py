"""How the words of a parameter's choices are looked up in the catalogue.

Settings, command lines and models hold the choices as they are (``mean``); only lists of dialogs show their words.
"""

from __future__ import annotations

import re
from collections.abc import Callable

CHOICE = "choice {0}"
"""The message of a choice: a plain word such as ``mean`` may have another sense elsewhere."""
_WORD = re.compile(r"[a-z][a-z0-9_-]{2,}")
"""Not a unit such as km, a size of paper or a pattern such as K12+345."""


def is_word(choice: str) -> bool:
    """Whether a choice is said in the words of a language."""
    return _WORD.fullmatch(choice) is not None


def shown_choice(choice: str, translate: Callable[[str], str]) -> str:
    """A choice in a list: its translation with the choice itself, as help and settings call it; else that alone."""
    message = CHOICE.format(choice)
    said = translate(message) if is_word(choice) else message
    return choice if said == message else f"{said} ({choice})"
