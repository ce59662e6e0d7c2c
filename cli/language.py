"""The language of the terminal: every sentence passes through ``say`` before anybody reads it."""

from __future__ import annotations

import inspect
import os
from typing import Any

import click

from ..interface.language import AUTOMATIC, LANGUAGE_VARIABLE, LANGUAGES, current_language, translator


def say(text: str) -> str:
    """``text`` in the language of this process."""
    return translator(current_language())(text)


def framed(frame: str, text: str) -> str:
    """``text`` in the place {0} of ``frame``, both in the language of this process."""
    return say(frame).replace("{0}", say(text))


def paragraphs(text: str) -> list[str]:
    """The paragraphs of a command's description, each in one line and in the language of this process."""
    cleaned = inspect.cleandoc(text).partition("\f")[0]
    return [say(" ".join(part.split())) for part in cleaned.split("\n\n") if part.strip()]


def take_language(context: click.Context, parameter: click.Parameter, value: str | None) -> None:
    """Of this process and its children; read before any text is made."""
    if value == AUTOMATIC:
        os.environ.pop(LANGUAGE_VARIABLE, None)  # what is given here overrules it
    elif value is not None:
        os.environ[LANGUAGE_VARIABLE] = value


LANGUAGE: dict[str, Any] = {
    "type": click.Choice([AUTOMATIC, *LANGUAGES]),
    "default": None,
    "is_eager": True,
    "expose_value": False,
    "callback": take_language,
    "help": "Language of messages and report. auto: that of the system. SLOPEWATCH_LANGUAGE sets it for all runs.",
}
"""What ``--language`` is, for click."""
