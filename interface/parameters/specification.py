"""What a parameter is: default, limits, unit and text, from which dialogs and the command line are generated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from .profiles import PROFILES

T = TypeVar("T", bound="ParameterSet")
AUTO = "auto"
"""The word for a number that the data decide, 0 in the parameter groups."""


class ParameterError(ValueError):
    """A parameter has a value that it cannot take; the message names it, its value and its bounds."""


@dataclass(frozen=True)
class Specification:
    """What a dialog or a command line needs to know about one parameter.

    ``kind`` is the Python type (bool, int, float or str); ``choices`` is empty unless the value is one of a list;
    ``minimum`` and ``maximum`` are inclusive; ``help`` says what the parameter does and what larger values change.
    ``automatic`` is the least number that stands for itself where 0, or the word auto, leaves the choice to the data;
    None where there is no such choice.
    """

    name: str
    kind: type
    default: Any
    label: str
    unit: str
    help: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    advanced: bool
    automatic: float | None = None

    @property
    def label_with_unit(self) -> str:
        label = self.label if self.automatic is None else f"{self.label}, 0 for {AUTO}"
        return f"{label} ({self.unit})" if self.unit else label

    @property
    def option(self) -> str:
        """Name on the command line, without dashes in front: ``cloth-resolution``."""
        return self.name.replace("_", "-")

    @property
    def qgis_name(self) -> str:
        """Name in a Processing algorithm: ``CLOTH_RESOLUTION``."""
        return self.name.upper()

    def check(self, value: Any) -> Any:
        """Return ``value`` as ``kind``.

        Raises:
            ParameterError: not of the kind, not finite, out of bounds or not among the choices.
        """
        try:
            if self.kind is bool:
                if not isinstance(value, bool):
                    raise ValueError
            elif self.kind is int:
                if isinstance(value, bool) or int(value) != float(value):
                    raise ValueError
                value = int(value)
            elif self.kind is float:
                if isinstance(value, bool):
                    raise ValueError
                value = 0.0 if self.automatic is not None and value == AUTO else float(value)
                if not math.isfinite(value):
                    raise ValueError
            elif not isinstance(value, str):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}") from None
        below = self.minimum is not None and value < self.minimum
        below = below or (self.automatic is not None and 0 < value < self.automatic)
        above = self.maximum is not None and value > self.maximum
        if below or above or (self.choices and value not in self.choices):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}")
        return value

    def _domain(self) -> str:
        if self.choices:
            return "one of " + ", ".join(self.choices)
        noun = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[self.kind]
        unit = f" {self.unit}" if self.unit else ""
        if self.automatic is not None:
            return f"{noun} from {self.automatic:g} to {self.maximum:g}{unit}, or {AUTO}"
        if self.minimum is not None and self.maximum is not None:
            return f"{noun} from {self.minimum:g} to {self.maximum:g}{unit}"
        if self.minimum is not None:
            return f"{noun} of at least {self.minimum:g}{unit}"
        return noun + unit


def _parameter(
    default: Any,
    label: str,
    help: str,  # noqa: A002 - the word users know
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    advanced: bool = False,
    automatic: float | None = None,
) -> Any:
    return field(
        default=default,
        metadata={
            "label": label,
            "unit": unit,
            "help": help,
            "minimum": minimum,
            "maximum": maximum,
            "choices": choices,
            "advanced": advanced,
            "automatic": automatic,
        },
    )


def _other_default(group: type[ParameterSet], name: str, default: Any) -> Any:
    """The parameter ``name`` of another group with a default of its own."""
    return field(default=default, metadata=next(f.metadata for f in fields(group) if f.name == name))


@dataclass(frozen=True)
class ParameterSet:
    """Base of the parameter groups: checked on construction, built from names and values."""

    def __post_init__(self) -> None:
        for specification in self.specifications():
            value = specification.check(getattr(self, specification.name))
            object.__setattr__(self, specification.name, value)

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(
            Specification(name=f.name, kind=type(f.default), default=f.default, **f.metadata) for f in fields(cls)
        )

    def named(self) -> dict[str, Any]:
        """The values by name; what is left to the data as the word for it."""
        values = {s.name: (s, getattr(self, s.name)) for s in self.specifications()}
        every = {f.name: getattr(self, f.name) for f in fields(self)}
        left = {name for name, (s, value) in values.items() if s.automatic is not None and value == 0}
        return {name: AUTO if name in left else value for name, value in every.items()}

    @classmethod
    def build(cls: type[T], values: Mapping[str, Any] | None = None, profile: str = "default") -> T:
        """The profile's values for this group and those it extends, overridden by those of ``values`` that are not None
        and belong to this group.

        Raises:
            ParameterError: an unknown profile, or a value out of bounds.
        """
        if profile not in PROFILES:
            raise ParameterError(f"profile is {profile!r}; give one of {', '.join(PROFILES)}")
        merged: dict[str, Any] = {}
        for group in reversed(cls.__mro__):
            merged.update(PROFILES[profile].get(group.__name__, {}))
        names = {f.name for f in fields(cls)}
        merged.update({k: v for k, v in (values or {}).items() if k in names and v is not None})
        return cls(**merged)
