"""Figures of a run record as they stand in the report: rounded for people, with their exact value and their place."""

from __future__ import annotations

import math
from typing import Any

from markupsafe import Markup

from ...interface.language import current_language, translator
from ...interface.rounding import digits_of_error, significant_decimals
from ..core.number_text import fixed

#: A key of the record, or several in a row.
Key = str | int | tuple[str | int, ...]
LEAST_ERROR = 1e-6  # in metres, m² or m³: below it nothing has a meaning
#: What stands where a figure is not known.
UNKNOWN = Markup('<span class="unknown">not known</span>')


class Figures:
    """Looks up and formats the figures of one run record.

    Every figure becomes an HTML ``data`` element with its exact value and, as a JSON pointer (RFC 6901), its place in
    ``run.json``, so that a program, or a reader of the source, can check the report against the record.
    """

    def __init__(self, record: dict[str, Any]) -> None:
        self.record = record
        self._say = translator(current_language())

    def value(self, *place: Key) -> Any:
        """What stands at a place of the record, such as ("metrics", "zone_count"); None where there is nothing."""
        found: Any = self.record
        for key in _flat(place):
            if isinstance(found, dict):
                found = found.get(str(key))
            elif isinstance(found, list) and isinstance(key, int) and key < len(found):
                found = found[key]
            else:
                return None
        return found

    def __call__(
        self,
        *place: Key,
        unit: str = "",
        digits: int = 3,
        scale: float = 1.0,
        sign: bool = False,
        grouped: bool = True,
    ) -> Markup:
        """The number at ``place`` times ``scale``, with ``digits`` decimals and ``unit``; a word where it is not known.

        Args:
            sign: also write the plus of a positive number.
            grouped: thousands are set apart; coordinates are not.
        """
        value = self.value(*place)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            return UNKNOWN
        text = number(value * scale, digits, sign=sign, grouped=grouped)
        pointer = "/" + "/".join(str(key).replace("~", "~0").replace("/", "~1") for key in _flat(place))
        factor = Markup(' data-scale="{}"').format(f"{scale:g}") if scale != 1.0 else Markup("")
        figure = Markup('<data value="{}" data-from="{}"{}>{}</data>').format(repr(value), pointer, factor, text)
        return figure + Markup("&nbsp;{}").format(self._say(unit)) if unit else figure

    def with_error(
        self, place: tuple[Key, ...], error: tuple[Key, ...], unit: str = "", digits: int = 3, **more: Any
    ) -> Markup:
        """A figure with its standard error, whose two significant digits say where both end: 1.234 ± 0.041 m³.

        Without the error where that is not known, or nothing; then with ``digits`` decimals.
        """
        scale = more.get("scale", 1.0)
        uncertain = self.value(*error)
        known = isinstance(uncertain, (int, float)) and math.isfinite(uncertain) and uncertain * scale > LEAST_ERROR
        if not known or self(*place) == UNKNOWN:
            return self(*place, unit=unit, digits=digits, **more)
        digits = digits_of_error(uncertain * scale)
        return Markup("{}&nbsp;±&nbsp;{}").format(
            self(*place, digits=digits, **more), self(*error, unit=unit, digits=digits, scale=scale)
        )

    def significant(self, *place: Key, unit: str = "") -> Markup:
        """A figure without an error: two significant digits, more only before the point."""
        value = self.value(*place)
        known = isinstance(value, (int, float)) and math.isfinite(value)
        return self(*place, unit=unit, digits=significant_decimals(value) if known else 0)

    def percent(self, *place: Key, digits: int = 0) -> Markup:
        """A share as a percentage."""
        return self(*place, unit="%", digits=digits, scale=100.0)


def _flat(place: tuple[Any, ...]) -> tuple[str | int, ...]:
    """Keys in a row; a part of a place may be given as a tuple."""
    return tuple(key for part in place for key in (part if isinstance(part, tuple) else (part,)))


def number(value: float, digits: int, *, sign: bool = False, grouped: bool = True) -> str:
    """``value`` with thousands set apart by commas and a true minus; a zero has no sign."""
    return fixed(value, digits, sign=sign, grouped=grouped).replace("-", "\u2212")
