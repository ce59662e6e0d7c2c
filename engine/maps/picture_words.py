"""Words drawn into pictures: in the language of the run, as far as a font on the machine has its letters."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from matplotlib import font_manager
from matplotlib.axis import Axis
from matplotlib.dates import MONTHLY, AutoDateLocator, ConciseDateFormatter
from matplotlib.font_manager import FontEntry, FontProperties

from ...interface.language import ENGLISH, current_language, translator
from ..core.progress import Progress

NO_FONT = (
    "No font with Chinese letters was found on this computer, so the words in pictures stay English; install one, such "
    "as Noto Sans CJK SC, and make the report again."
)
_LATIN = "DejaVu Sans"
_OWN = "slopewatch-"
"""Begins the name by which pictures ask for a font: matplotlib warns of each weight that the font's own name lacks."""
_FAMILIES = Path(__file__).with_name("chinese_fonts.csv")
_PROBE = "检测限隆起沉降"
"""A font that has these has the other words, too: they are of the first level of GB/T 2312."""
_HAN = r"\u3007\u4e00-\u9fff"
_CLOSING = r"，。；：！？、）》”’"
# A Chinese letter with the punctuation that must not begin a line, or a word of other letters.
_PIECE = re.compile(rf"( ?)([{_HAN}][{_CLOSING}]*|[^ {_HAN}]+)")
_NUMERIC_DATES = ["%Y", "%Y-%m", "%m-%d", "%H:%M", "%H:%M", "%S.%f"]
_NUMERIC_OFFSETS = ["", "%Y", "%Y", "%Y-%m-%d", "%Y-%m-%d", "%Y-%m-%d %H:%M"]


def say(text: str) -> str:
    """``text`` as pictures say it: in the language of this process, English where no font has its letters."""
    return translator(picture_language())(text)


def picture_language() -> str:
    """The language of the words in pictures."""
    language = current_language()
    return language if language == ENGLISH or chinese_font() else ENGLISH


def say_missing_font(progress: Progress | None) -> None:
    """One line in the log of a process where pictures stay English in a run of another language."""
    if progress is not None and picture_language() != current_language() and _first_time():
        progress.info(NO_FONT)


@lru_cache
def fonts(size: float, weight: str = "normal") -> FontProperties:
    """The one font of all pictures, ``size`` in points; letters that it lacks are those of a Chinese one."""
    families = [_LATIN] if any(font.name == _LATIN for font in _installed()) else ["sans-serif"]
    if chinese_font():
        families.append(f"{_OWN}{chinese_font()}")
    return FontProperties(family=families, size=size, weight=weight)


@lru_cache
def chinese_font() -> str:
    """Name of the font with Chinese letters that pictures use; empty where there is none."""
    found = _first_chinese()
    if not found and current_language() != ENGLISH:
        # matplotlib's list of fonts is older than a font that was installed since
        _look_again()
        found = _first_chinese()
    return found


def chinese_font_files() -> list[Path]:
    """The files of that font, for its weights; none where there is none."""
    name = f"{_OWN}{chinese_font()}"
    return sorted({Path(font.fname) for font in _installed() if chinese_font() and font.name == name})


def date_axis(axis: Axis, max_ticks: int | None = None) -> None:
    """Days along an axis, whose months have no English names where the words are in another language."""
    locator = AutoDateLocator(maxticks=max_ticks)
    locator.intervald[MONTHLY] = [1, 2, 3, 4, 6, 12]  # without a year, few ticks on four years are warned of
    numeric: dict[str, Any] = {}
    if picture_language() != ENGLISH:
        numeric = {"formats": _NUMERIC_DATES, "offset_formats": _NUMERIC_OFFSETS}
    axis.set_major_locator(locator)
    axis.set_major_formatter(ConciseDateFormatter(locator, **numeric))


def pieces(text: str) -> list[tuple[str, str]]:
    """What a line of text may be broken between: each with the blank that stands before it, if any."""
    return _PIECE.findall(text)


_asked: list[bool] = []


def _first_time() -> bool:
    _asked.append(True)
    return len(_asked) == 1


def _nearest(fonts: Sequence[FontEntry], weight: int) -> FontEntry:
    """The upright one, if any, whose weight is nearest."""
    return min(fonts, key=lambda font: (font.style != "normal", _far(font, weight)))


def _first_chinese() -> str:
    """The first family of ``chinese_fonts.csv`` that is there, with which matplotlib can draw."""
    with _FAMILIES.open(encoding="utf-8", newline="") as table:
        wanted = [row["family"] for row in csv.DictReader(table)]
    by_name: dict[str, list[FontEntry]] = {}
    for font in _installed():
        by_name.setdefault(font.name, []).append(font)
    for family in wanted:
        for weight in (400, 700) if family in by_name else ():
            nearest = _nearest(by_name[family], weight)
            _installed().append(dataclasses.replace(nearest, name=f"{_OWN}{family}", weight=weight))
        if family in by_name and _has_chinese(f"{_OWN}{family}"):
            return family
    return ""


def _installed() -> list[FontEntry]:
    return font_manager.fontManager.ttflist


def _far(font: FontEntry, weight: int) -> int:
    own = font.weight if isinstance(font.weight, int) else font_manager.weight_dict.get(font.weight, 400)
    return abs(own - weight)


def _has_chinese(family: str) -> bool:
    """Whether its file is there and has the letters: a list may be old, and a font cut down to some of them."""
    try:
        font = font_manager.get_font(font_manager.findfont(FontProperties(family=[family]), fallback_to_default=False))
    except (OSError, RuntimeError, ValueError):
        return False
    return all(font.get_char_index(ord(letter)) for letter in _PROBE)


def _look_again() -> None:
    known = {Path(font.fname) for font in _installed()}
    for path in font_manager.findSystemFonts():
        if Path(path) not in known:
            with contextlib.suppress(OSError, RuntimeError, ValueError):
                font_manager.fontManager.addfont(path)
