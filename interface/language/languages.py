"""Which languages there are, and which one somebody reads."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from .catalogue import read_catalogue
from .translator import Translator

ENGLISH = "en"
AUTOMATIC = "auto"
"""The language of the environment."""
LANGUAGES = {ENGLISH: "English", "zh_CN": "简体中文"}
LANGUAGE_VARIABLE = "SLOPEWATCH_LANGUAGE"
"""The environment variable that names the language of a process and of its children."""
_FOLDER = Path(__file__).resolve().parent


def language_of(locale: str) -> str:
    """The language for a locale's name such as ``zh_CN.UTF-8``, ``zh-Hans`` or ``de``: English where there is none.

    Traditional Chinese readers are better served by English than by the other script.
    """
    name = locale.partition(".")[0].partition("@")[0].replace("-", "_").lower()
    if name in ("zh", "zh_cn", "zh_sg", "zh_hans") or name.startswith("zh_hans_"):
        return "zh_CN"
    return ENGLISH


def language_of_environment(environment: Mapping[str, str]) -> str:
    """The language that the environment asks for, by SLOPEWATCH_LANGUAGE or gettext's own variables (GNU gettext
    manual, "Locale Environment Variables").
    """
    for variable in (LANGUAGE_VARIABLE, "LC_ALL", "LC_MESSAGES", "LANG"):
        value = environment.get(variable, "")
        if value and value != AUTOMATIC:
            return language_of(value)
    return ENGLISH


def current_language() -> str:
    """The language of this process, as its environment asks for it."""
    return language_of_environment(os.environ)


@lru_cache(maxsize=4)
def translator(language: str) -> Translator:
    """Translates into ``language``; English stays as it is.

    Raises:
        ValueError: there is no such language.
    """
    if language not in LANGUAGES:
        raise ValueError(f"language is {language!r}; give one of {', '.join(LANGUAGES)}")
    return Translator({} if language == ENGLISH else read_catalogue(_FOLDER / f"{language}.po"))
