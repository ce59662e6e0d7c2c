"""How long modules and functions are, and how many parameters they take: past a limit there are two things in one."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
from slopewatch.tests.builders.walk import ROOT, nodes_in, text_of

SOURCES = ["api", "cli", "engine", "interface", "library", "models", "workflows"]
MODULE, FUNCTION, PARAMETERS = 400, 60, 7

COMMAND = "its arguments are the command's files and switches, each under its own name"
STEP = "the files and switches of a command, by name only"
CLOUDS = "both clouds and their plants, the areas and errors known: most are by name and have a default"
# An exception that is no longer needed fails: this list only gets shorter.
LONG_MODULES: dict[str, str] = {}
LONG_FUNCTIONS: dict[str, str] = {}
MANY_PARAMETERS = {
    "api/flight.py:plan_flight": STEP,
    "api/flow.py:batch": STEP,
    "api/flow.py:inspect": STEP,
    "api/flow.py:screen": STEP,
    "api/pairs.py:dem_change": STEP,
    "api/pairs.py:register": STEP,
    "api/pairs.py:change": STEP,
    "api/pairs.py:displacement": STEP,
    "api/pairs.py:m3c2": STEP,
    "api/flow.py:monitor": STEP,
    "library/distances.py:m3c2": STEP,
    "cli/commands.py:register": COMMAND,
    "cli/commands.py:change": COMMAND,
    "cli/displacement.py:displacement": COMMAND,
    "cli/m3c2.py:m3c2": COMMAND,
    "cli/screen.py:screen": COMMAND,
    "cli/series.py:series": COMMAND,
    "workflows/planflight.py:planflight_step": STEP,
    "workflows/compareflight.py:compareflight_step": STEP,
    "engine/grid/growing_cells.py:adaptive_cells": CLOUDS,
    "engine/ground/extraction.py:extract_ground": STEP,
    "interface/parameters/specification.py:_parameter": "the fields of a parameter's description, by name only",
    "models/screening/cloud_file.py:__init__": "how one file is read, by name only",
    "models/training/training.py:train": "model, data, and when to stop and save, by name only",
    "workflows/change.py:change_step": STEP,
    "workflows/demchange.py:demchange_step": STEP,
    "workflows/displacement.py:displacement_step": STEP,
    "workflows/inspect.py:inspect_slope": STEP,
    "workflows/m3c2.py:m3c2_step": STEP,
    "workflows/register.py:register_step": STEP,
    "workflows/series.py:monitor_series": STEP,
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


def modules() -> Iterator[tuple[str, str]]:
    """Path from the root and text of each module."""
    for source in SOURCES:
        place = ROOT / source
        for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), text_of(path)


def functions(text: str) -> Iterator[Function]:
    yield from (node for node in nodes_in(text) if isinstance(node, Function))


def length(function: Function) -> int:
    """Lines from ``def`` on, without those of the docstring."""
    lines = (function.end_lineno or 0) - function.lineno + 1
    if ast.get_docstring(function) is not None:
        first = function.body[0]
        lines -= (first.end_lineno or 0) - first.lineno + 1
    return lines


def parameters(function: Function) -> int:
    taken = function.args
    named = [a.arg for a in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)]
    return len([n for n in named if n not in ("self", "cls")]) + (taken.vararg is not None) + (taken.kwarg is not None)


def larger(found: dict[str, int], limit: int) -> dict[str, int]:
    return {name: size for name, size in found.items() if size > limit}


def sizes(measure) -> dict[str, int]:
    """The largest under each name, ``path:function``."""
    found: dict[str, int] = {}
    for path, text in modules():
        for function in functions(text):
            name = f"{path}:{function.name}"
            found[name] = max(found.get(name, 0), measure(function))
    return found


def check(found: dict[str, int], limit: int, exceptions: dict[str, str]) -> None:
    too_large = larger(found, limit)
    new = {name: size for name, size in too_large.items() if name not in exceptions}
    assert not new, f"above {limit}: look for the two things in each of {new}"
    done = sorted(exceptions.keys() - too_large)
    assert not done, f"no longer above {limit}: take them off the list: {done}"
    assert all(exceptions.values())


def test_modules_are_short():
    found = {path: len(text.splitlines()) for path, text in modules()}
    assert len(found) > 200
    check(found, MODULE, LONG_MODULES)


def test_functions_are_short():
    check(sizes(length), FUNCTION, LONG_FUNCTIONS)


def test_functions_take_few_parameters():
    check(sizes(parameters), PARAMETERS, MANY_PARAMETERS)


@pytest.mark.parametrize(("exceptions", "said"), [({}, "above 2"), ({"b": "old", "a": "long"}, r"take .*\['b'\]")])
def test_what_is_too_large_or_was_is_told(exceptions, said):
    with pytest.raises(AssertionError, match=said):
        check({"a": 3, "b": 2}, 2, exceptions)
    check({"a": 3, "b": 2}, 2, {"a": "long"})


def test_docstrings_and_self_are_not_counted():
    (function,) = functions('def f(self, a, *b, c=1, **d):\n    """One\n    two.\n    """\n    return a\n')
    assert (length(function), parameters(function)) == (2, 4)
