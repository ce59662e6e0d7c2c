"""Settings of a slope: which a command has, from the texts of a manifest, and as options of the command line."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from ...engine.core.errors import InputError
from ...engine.core.messages import quoted
from ...interface.parameters import (
    PROFILES,
    DetailParameters,
    ParameterError,
    ParameterSet,
    Specification,
    command_sets,
)
from .jobs import Job, Slope

INSPECT, SERIES = "inspect", "series"
_SETS = {INSPECT: command_sets.INSPECT, SERIES: command_sets.SERIES}
_OWN = ("overwrite",)  # the batch decides it
_DETAILS = frozenset(s.name for s in DetailParameters.specifications())
"""Other details need another report, not other results."""
_WORDS = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}


@lru_cache
def specifications(command: str = "") -> dict[str, Specification]:
    """The settings by name that a slope can have, or those of one command."""
    sets = _SETS[command] if command else (*_SETS[INSPECT], *_SETS[SERIES])
    return {s.name: s for group in sets for s in group.specifications() if s.name not in _OWN}


def command_of(slope: Slope, two_surveys: str) -> str:
    """One survey is screened by ``inspect``, two are compared by ``inspect`` or ``series``, more are a series."""
    count = len(slope.surveys)
    return SERIES if count > 2 or (count == 2 and two_surveys == SERIES) else INSPECT


def read_option(name: str, text: str) -> Any:
    """The value of a setting as a manifest's cell gives it.

    Raises:
        InputError: it is none that the setting can take.
    """
    specification = specifications()[name]
    value: Any = text.strip()
    if specification.kind is bool:
        value = _WORDS.get(value.lower(), value)
    elif specification.kind in (int, float):
        with contextlib.suppress(ValueError):  # the check says what it must be
            value = specification.kind(value)
    try:
        return specification.check(value)
    except ParameterError as error:
        raise InputError(f"{error}.") from None


def options_of(slope: Slope, command: str, common: Mapping[str, Any]) -> dict[str, Any]:
    """The settings given for all slopes that the command has, overridden by the slope's own."""
    given = {name: value for name, value in common.items() if value is not None} | dict(slope.options)
    if given.get("pdf"):
        given.setdefault("slope_name", slope.name)
    return {name: given[name] for name in specifications(command) if name in given}


def ground_is_given(options: Mapping[str, Any]) -> bool:
    """Whether all points of a series' clouds are taken as ground."""
    return bool(options.get("ground_ready")) or options.get("ground") == "as_is"


def details_in(options: Mapping[str, Any]) -> DetailParameters:
    """What a report to sign says of a slope, of its settings."""
    return DetailParameters.build({name: value for name, value in options.items() if name in _DETAILS})


def group_of(command: str, options: Mapping[str, Any], profile: str) -> dict[type[ParameterSet], ParameterSet]:
    """The parameter groups of a command by their class.

    Raises:
        InputError: settings that do not go together, or an unknown profile.
    """
    if profile not in PROFILES:
        raise InputError(f"profile is {quoted(profile)}; give one of {', '.join(PROFILES)}.")
    try:
        return {group: group.build({**options, "overwrite": True}, profile) for group in _SETS[command]}
    except ParameterError as error:
        raise InputError(f"{error}.") from None


def effective(command: str, options: Mapping[str, Any], profile: str) -> dict[str, Any]:
    """Every setting of a command that its results depend on with its value, for the task's id; see ``group_of`` for
    what is raised.
    """
    groups = group_of(command, options, profile).values()
    named = {s.name: getattr(group, s.name) for group in groups for s in group.specifications()}
    return {name: value for name, value in named.items() if name not in _OWN and name not in _DETAILS}


def arguments_of(job: Job) -> list[str]:
    """The job as arguments of ``slopewatch``. Values are part of their option, so that none is taken for an option."""
    arguments = [job.command, *(f"--epoch={day}={cloud}" for day, cloud in job.epochs)]
    arguments += [f"--{role.replace('_', '-')}={path}" for role, path in job.files.items()]
    arguments += [f"--output-dir={job.folder}", "--overwrite", f"--profile={job.profile}", "--progress=json"]
    for name, value in job.options.items():
        option = specifications()[name].option
        arguments.append(
            (f"--{option}" if value else f"--no-{option}")
            if value in (True, False) and isinstance(value, bool)
            else f"--{option}={value}"
        )
    return [*arguments, *([f"--pdal={job.pdal}"] if job.pdal else [])]
