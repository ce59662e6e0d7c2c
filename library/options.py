"""Functions whose further arguments are the parameters of some groups: named, with defaults, documented."""

from __future__ import annotations

import functools
import inspect
import textwrap
from collections.abc import Callable
from typing import Any, TypeVar

from ..interface.parameters import ParameterSet
from ..interface.parameters.specification import Specification

Function = TypeVar("Function", bound=Callable[..., Any])


def takes(*groups: type[ParameterSet]) -> Callable[[Function], Function]:
    """Give a function, which takes them as ``**parameters``, the signature and the documentation of these groups."""

    def decorate(function: Function) -> Function:
        own = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.VAR_KEYWORD]
        given = {p.name for p in own}
        every = {s.name: s for group in groups for s in group.specifications() if s.name not in given}
        named = [
            inspect.Parameter(s.name, inspect.Parameter.KEYWORD_ONLY, default=s.default, annotation=_kind(s))
            for s in every.values()
        ]

        @functools.wraps(function)
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            return function(*args, **kwargs)

        wrapper.__signature__ = inspect.signature(function).replace(parameters=[*own, *named])  # type: ignore[attr-defined]
        wrapper.__doc__ = _with_parameters(inspect.cleandoc(function.__doc__ or ""), every)
        return wrapper  # type: ignore[return-value]

    return decorate


def _kind(parameter: Specification) -> Any:
    return parameter.kind | str if parameter.automatic else parameter.kind


def _with_parameters(text: str, parameters: dict[str, Specification]) -> str:
    lines = [text, "", "Other Parameters", "----------------"]
    for one in parameters.values():
        kind = " | ".join(repr(c) for c in one.choices) or (
            f"{one.kind.__name__} or 'auto'" if one.automatic else one.kind.__name__
        )
        unit = f", {one.unit}" if one.unit else ""
        lines.append(f"{one.name} : {kind}{unit}, default {one.default!r}")
        lines += textwrap.wrap(one.help, 112, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)
