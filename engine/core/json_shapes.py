"""JSON files checked once, where they are read, against the shape that their readers rely on.

A shape is a function that takes a value and its place and raises ``MisfitError`` unless the value is as wanted. Every
value is checked on the way for what no reader here can use: numbers that are not finite or beyond ``LARGEST``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

from ...interface.input_files import RECORD, InputKind
from .errors import InputError
from .input_files import read_input
from .messages import shown

LARGEST = 1e15
"""Of numbers: sums, squares and axes of them stay finite, and whole ones are exact as floating point numbers."""
_MAX_NUMBER_DIGITS = 400
_MAX_HELD_B = 300_000_000
_HELD_B = {b"{": 250, b"[": 64, b":": 150, b",": 32}
"""Bytes of memory that what follows such a sign takes at most in CPython, beside its text."""

Shape = Callable[[Any, str], None]


class MisfitError(ValueError):
    """``place`` in the document, such as ``level.median_m``, and what is wanted there."""

    def __init__(self, place: str, wanted: str) -> None:
        super().__init__(f"{place or 'it'} is not {wanted}")


_DAY_LETTERS = len("YYYY-MM-DD")


def read_json(path: Path, shape: Shape, sentence: str, kind: InputKind = RECORD) -> Any:
    """The document in a JSON file.

    Args:
        sentence: for the message, with ``{path}`` and ``{why}``; it names the remedy.

    Raises:
        FileNotFoundError: there is no such file; what that means, the caller knows.
        InputError: it cannot be read, is no JSON in UTF-8, or its shape is another.
    """
    content = read_input(path, kind)
    try:
        document = parse_json(content)
        shape(document, "")
    except ValueError as error:
        raise InputError(sentence.format(path=shown(path), why=error)) from error
    return document


def parse_json(data: bytes) -> Any:
    """The document in the bytes of a JSON file.

    Raises:
        ValueError: they are no JSON in UTF-8, hold more values than memory should, lists are nested too deep, or a
            number is none.
    """
    if not data:
        raise ValueError("it is empty")
    if sum(data.count(sign) * size for sign, size in _HELD_B.items()) > _MAX_HELD_B:
        raise ValueError("it holds too many values")
    try:
        return json.loads(data.decode("utf-8"), parse_constant=_no_number, parse_int=_whole)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    except UnicodeDecodeError:
        raise ValueError("it is no text in UTF-8") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"it is no JSON: {error.msg} in line {error.lineno}") from None


def _no_number(word: str) -> float:
    raise ValueError(f"it holds {word}, which is no number")


def _whole(digits: str) -> int:
    if len(digits) > _MAX_NUMBER_DIGITS:
        raise ValueError(f"it holds a number of {len(digits)} digits")
    return int(digits)


def anything(value: Any, place: str) -> None:
    """Any value whose numbers can be used."""
    if isinstance(value, dict):
        for name, part in value.items():
            anything(part, _below(place, name))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            anything(part, f"{place}[{index}]")
    elif isinstance(value, (int, float)) and not abs(value) <= LARGEST:  # what is no number is not, either
        raise MisfitError(place, "a number that can be used")


def number(low: float = -LARGEST, high: float = LARGEST, *, whole: bool = False, above: bool = False) -> Shape:
    """A number from ``low`` to ``high``; with ``above`` larger than ``low``, with ``whole`` one without decimals."""
    wanted = "a whole number" if whole else "a number"
    if low > -LARGEST or high < LARGEST:
        wanted += f" above {low:g}" if above else f" of at least {low:g}"
        wanted += f" and at most {high:g}" if high < LARGEST else ""

    def check(value: Any, place: str) -> None:
        kinds = int if whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high or (
            above and value == low
        ):  # fmt: skip
            raise MisfitError(place, wanted)

    return check


def text(pattern: str = "", wanted: str = "a text") -> Shape:
    """A text; all of it matches ``pattern`` where one is given."""

    def check(value: Any, place: str) -> None:
        if not isinstance(value, str) or (pattern and not re.fullmatch(pattern, value)):
            raise MisfitError(place, wanted)

    return check


def day(value: Any, place: str) -> None:
    """A date written as YYYY-MM-DD."""
    try:
        if not isinstance(value, str) or date.fromisoformat(value).isoformat() != value:
            raise ValueError
    except ValueError:
        raise MisfitError(place, "a date written as YYYY-MM-DD") from None


def moment(value: Any, place: str) -> None:
    """A text that begins with a day as YYYY-MM-DD, such as the time at which a run began."""
    day(value[:_DAY_LETTERS] if isinstance(value, str) else value, place)


def truth(value: Any, place: str) -> None:
    """true or false."""
    if not isinstance(value, bool):
        raise MisfitError(place, "true or false")


def maybe(shape: Shape) -> Shape:
    """What has the shape, or null."""

    def check(value: Any, place: str) -> None:
        if value is not None:
            shape(value, place)

    return check


def rows(shape: Shape, least: int = 0, most: int = 10_000_000) -> Shape:
    """A list of ``least`` to ``most`` values of one shape."""
    wanted = "a list" + (f" of {least}" if least == most else f" of at least {least}" if least else "")

    def check(value: Any, place: str) -> None:
        if not isinstance(value, (list, tuple)) or not least <= len(value) <= most:
            raise MisfitError(place, wanted)
        for index, part in enumerate(value):
            shape(part, f"{place}[{index}]")

    return check


def table(shape: Shape) -> Shape:
    """An object whose values, whatever their names, have one shape."""

    def check(value: Any, place: str) -> None:
        if not isinstance(value, dict):
            raise MisfitError(place, "an object")
        for name, part in value.items():
            shape(part, _below(place, name))

    return check


def fields(required: Mapping[str, Shape], optional: Mapping[str, Shape] | None = None) -> Shape:
    """An object with the ``required`` fields; others may be there, those in ``optional`` only in their shape."""
    known = {**(optional or {}), **required}

    def check(value: Any, place: str) -> None:
        if not isinstance(value, dict):
            raise MisfitError(place, "an object")
        for name in required:
            if name not in value:
                raise MisfitError(_below(place, name), "there")
        for name, part in value.items():
            known.get(name, anything)(part, _below(place, name))

    return check


def _below(place: str, name: str) -> str:
    """The place of a field, as a message shows it: what no field of ours is named is cut and made printable."""
    plain = name if name.isidentifier() and name.isascii() else ascii(name[:30])
    return f"{place}.{plain}" if place else plain
