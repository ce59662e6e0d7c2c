"""What a parameter is: default, limits, unit and text, from which dialogs and the command line are generated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, TypeVar

from .profiles import PROFILES

T = TypeVar("T", bound="ParameterSet")
AUTO = "auto"
"""The value of a number that is left to the data or the machine."""


class ParameterError(ValueError):
    """A parameter has a value that it cannot take; the message names it, its value and its bounds."""


def given(value: float | str) -> float | None:
    """The number that a parameter was given; None where it is AUTO."""
    return None if isinstance(value, str) else value


@dataclass(frozen=True)
class Specification:
    """What a dialog or a command line needs to know about one parameter.

    ``kind`` is the Python type (bool, int, float or str); ``choices`` is empty unless the value is one of a list;
    ``minimum`` and ``maximum`` are inclusive; ``help`` says what the parameter does and what larger values change.
    ``automatic`` says that AUTO is the default and a value in addition to the numbers.
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
    automatic: bool

    @property
    def auto_number(self) -> float | None:
        """The number that stood for AUTO in earlier versions' dialogs, models and records, and still does."""
        return None if not self.automatic else 0 if self.minimum else -1

    @property
    def field_default(self) -> Any:
        """The default in a field that holds only numbers: an empty one stands for AUTO."""
        return None if self.automatic else self.default

    @property
    def field_minimum(self) -> float | None:
        """The least number of such a field, with the one that models of earlier versions hold."""
        return self.auto_number if self.automatic else self.minimum

    @property
    def field_label(self) -> str:
        """The label of such a field, with the unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    @property
    def option(self) -> str:
        """Name on the command line, without dashes in front: ``cloth-resolution``."""
        return self.name.replace("_", "-")

    @property
    def qgis_name(self) -> str:
        """Name in a Processing algorithm: ``CLOTH_RESOLUTION``."""
        return self.name.upper()

    def check(self, value: Any) -> Any:
        """``value`` as ``kind``, or AUTO.

        Raises:
            ParameterError: not of the kind, not finite, out of bounds or not among the choices.
        """
        try:
            if self.automatic and not isinstance(value, bool) and value in (AUTO, self.auto_number):
                return AUTO
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
                value = float(value)
                if not math.isfinite(value):
                    raise ValueError
            elif not isinstance(value, str):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}") from None
        below = self.minimum is not None and value < self.minimum
        above = self.maximum is not None and value > self.maximum
        if below or above or (self.choices and value not in self.choices):
            raise ParameterError(f"{self.name} is {value!r}; give {self._domain()}")
        return value

    def _domain(self) -> str:
        if self.choices:
            return "one of " + ", ".join(self.choices)
        noun = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}[self.kind]
        unit = f" {self.unit}" if self.unit else ""
        if self.automatic:
            return f"{noun} from {self.minimum:g} to {self.maximum:g}{unit}, or {AUTO}"
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
    kind: type | None = None,
    unit: str = "",
    bounds: tuple[float | None, float | None] = (None, None),
    choices: tuple[str, ...] = (),
    advanced: bool = False,
) -> Any:
    """A field of a parameter set; ``kind`` is the type of the numbers where the default is AUTO."""
    metadata = {
        "kind": kind or type(default),
        "label": label,
        "unit": unit,
        "help": help,
        "minimum": bounds[0],
        "maximum": bounds[1],
        "choices": choices,
        "advanced": advanced,
        "automatic": kind is not None,
    }
    return field(default=default, metadata=metadata)


def _other_default(group: type[ParameterSet], name: str, default: Any) -> Any:
    """The parameter ``name`` of another group with a default of its own."""
    return field(default=default, metadata=next(f.metadata for f in fields(group) if f.name == name))


@dataclass(frozen=True)
class ParameterSet:
    """Base of the parameter sets: checked on construction, built from names and values.

    ``record_name`` is the set's name in run records and profiles. ``title`` is the heading under which the dialogs and
    ``--help`` show its parameters: the step of the workflow. Sets of one title stand under one heading.
    """

    record_name: ClassVar[str] = ""
    title: ClassVar[str] = ""

    def __init_subclass__(cls, record_name: str = "", title: str = "") -> None:
        cls.record_name = record_name or cls.record_name
        cls.title = title or cls.title or cls.record_name.replace("_", " ").capitalize()

    def __post_init__(self) -> None:
        for specification in self.specifications():
            value = specification.check(getattr(self, specification.name))
            object.__setattr__(self, specification.name, value)

    @classmethod
    def specifications(cls) -> tuple[Specification, ...]:
        return tuple(Specification(name=f.name, default=f.default, **f.metadata) for f in fields(cls))

    @classmethod
    def build(cls: type[T], values: Mapping[str, Any] | None = None, profile: str = "default") -> T:
        """The profile's values for this set, overridden by those of ``values`` that are not None and belong to it.

        Raises:
            ParameterError: an unknown profile, or a value out of bounds.
        """
        if profile not in PROFILES:
            raise ParameterError(f"profile is {profile!r}; give one of {', '.join(PROFILES)}")
        merged = {**PROFILES[profile].get(cls.record_name, {})}
        merged.update({k: v for k, v in (values or {}).items() if v is not None})
        names = {f.name for f in fields(cls)}
        return cls(**{name: value for name, value in merged.items() if name in names})


def profile_values(groups: Iterable[type[ParameterSet]], profile: str) -> dict[str, Any]:
    """The values of all parameters of some sets with a profile, by name.

    Raises:
        ParameterError: an unknown profile.
    """
    made = [group.build(profile=profile) for group in groups]
    return {s.name: getattr(one, s.name) for one in made for s in one.specifications()}
