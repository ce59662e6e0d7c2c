"""Settings given back: the parameters of a former run's ``run.json``, or a JSON or TOML file of names and values.

Paths of inputs and outputs are never taken from such a file, nor whether earlier results are overwritten.
"""

from __future__ import annotations

import difflib
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .input_files import SETTINGS, TOML_SETTINGS, MissingFileError, UnusableFileError, read_input
from .parameters import AUTO, PROFILES, OutputParameters, ParameterError, ParameterSet, Specification, command_sets

if sys.version_info >= (3, 11):
    import tomllib

_MAX_VALUES = 1_000_000
_MAX_KEY_DOTS = 20
_DOTTED = re.compile(rf"""(?:[\w"'-]+[ \t]*\.[ \t]*){{{_MAX_KEY_DOTS}}}""")
_SHOWN = 300  # characters of a value in a sentence
_NOT_TAKEN = {s.name for s in OutputParameters.specifications()}
_BOOLEANS = {"yes": True, "true": True, "on": True, "1": True, "no": False, "false": False, "off": False, "0": False}
_REMEDY = "give a run.json, or a JSON or TOML file of settings"


@dataclass(frozen=True)
class GivenSettings:
    """What a file of settings gives to one command.

    Attributes
    ----------
    values : the parameters by name, each checked.
    profile : name of the profile that they override; empty where the file names none.
    left_out : headings and names of a run record that the command does not have.
    """

    values: Mapping[str, Any]
    profile: str = ""
    left_out: tuple[str, ...] = ()

    def over(self, groups: Sequence[type[ParameterSet]], profile: str) -> dict[str, Any]:
        """The values that differ from those of a profile, by name."""
        built = [(group, group.build(profile=profile)) for group in groups]
        used = {s.name: getattr(values, s.name) for group, values in built for s in group.specifications()}
        return {name: value for name, value in self.values.items() if value != used.get(name)}


def read_settings(path: Path, groups: Sequence[type[ParameterSet]]) -> GivenSettings:
    """The settings of a file for the parameter sets of one command.

    Of a run record of any command those parameters are taken that this command has, too. In another file every name
    must be one of this command's: with dashes or underscores, alone or in a table of its set (``[ground]``).

    Raises:
        ParameterError: the file cannot be read, or a name or value in it is none that the command knows.
    """
    content = _content(path)
    if isinstance(content.get("parameters"), dict) and "command" in content:
        return _of_record(path, content, groups)
    profile = content.pop("profile", "")
    _check_profile(path, profile)
    known = _by_name(groups)
    values: dict[str, Any] = {}
    for name, value in _flat(content, {group.record_name for group in groups}):
        if name not in known:
            raise ParameterError(_unknown(path, name, known))
        values[name] = _checked(path, known[name], value)
    return GivenSettings(values, profile)


def read_assignments(texts: Sequence[str], groups: Sequence[type[ParameterSet]]) -> dict[str, Any]:
    """Values by name, from texts such as ``cell=0.2`` or ``ground.cloth_resolution=0.3``; the last of a name counts.

    Raises:
        ParameterError: a text is not written so, or a group, name or value in it is none that the command knows.
    """
    values: dict[str, Any] = {}
    for text in texts:
        left, sign, value = text.partition("=")
        group, _, name = left.strip().replace("-", "_").rpartition(".")
        known = _by_name([one for one in groups if group in ("", one.record_name)])
        if not sign or name not in known:
            close = difflib.get_close_matches(name, _by_name(groups), 1)
            remedy = f"it may mean {close[0]}" if close else "write it as NAME=VALUE"
            raise ParameterError(f"--set {_short(text)} names no parameter of this command; {remedy}")
        values[name] = known[name].check(_typed(known[name], value.strip()))
    return values


def _typed(specification: Specification, text: str) -> Any:
    """What a text means for a parameter; the text itself where it means nothing."""
    if specification.kind is bool:
        return _BOOLEANS.get(text.lower(), text)
    try:
        return text if specification.kind is str else float(text)
    except ValueError:
        return text


def _of_record(path: Path, record: Mapping[str, Any], groups: Sequence[type[ParameterSet]]) -> GivenSettings:
    theirs = getattr(command_sets, str(record["command"]).upper().replace(" ", "_"), None)
    offered = None if theirs is None else {(g.record_name, s.name) for g in theirs for s in g.specifications()}
    values: dict[str, Any] = {}
    left_out: list[str] = []
    own = {group.record_name: group for group in groups}
    for heading, given in record["parameters"].items():
        if heading not in own or not isinstance(given, dict):
            left_out += [] if heading == "outputs" else [str(heading)]
            continue
        known = _by_name([own[heading]])
        for name, value in given.items():
            if offered is not None and (heading, name) not in offered:  # of the set, but not for people to give
                continue
            if name in known:
                values[name] = _checked(path, known[name], value)
            else:
                left_out += [] if name in _NOT_TAKEN else [str(name)]
    profile = record.get("profile", "")
    common = record.get("settings")
    if isinstance(common, dict):  # a batch records what it was given, by name
        known = _by_name(groups)
        values.update({n: _checked(path, known[n], v) for n, v in common.items() if n in known})
        left_out += [str(n) for n in common if n not in known and n not in _NOT_TAKEN]
    _check_profile(path, profile)
    return GivenSettings(values, profile, tuple(left_out))


def _content(path: Path) -> dict[str, Any]:
    kind = "TOML" if path.suffix.lower() == ".toml" else "JSON"
    try:
        text = read_input(path, TOML_SETTINGS if kind == "TOML" else SETTINGS).decode("utf-8-sig")
    except MissingFileError:
        raise ParameterError(f"{path} does not exist; {_REMEDY}") from None
    except UnusableFileError as error:
        raise ParameterError(str(error).rstrip(".")) from None
    except ValueError:
        raise ParameterError(f"{path} cannot be read as settings (its text is not UTF-8); {_REMEDY}") from None
    try:
        content = _toml(path, text) if kind == "TOML" else _json(text)
    except ParameterError:
        raise
    except (ValueError, RecursionError) as error:
        why = str(error).splitlines()[0][:_SHOWN]
        raise ParameterError(f"{path} is no {kind} file that can be read ({why}); {_REMEDY}") from None
    if not isinstance(content, dict):
        raise ParameterError(f"{path} holds no names with values; {_REMEDY}")
    return content


def _toml(path: Path, text: str) -> dict[str, Any]:
    if _DOTTED.search(text):  # the parser takes memory by the square of the dots
        raise ValueError(f"a name has more than {_MAX_KEY_DOTS} dots")
    if sys.version_info >= (3, 11):
        return tomllib.loads(text)
    raise ParameterError(f"{path} is TOML, which needs Python 3.11 or later; give the settings as JSON")


def _json(text: str) -> Any:
    if sum(text.count(sign) for sign in "[{,:") > _MAX_VALUES:
        raise ValueError("it holds too many values")
    return json.loads(text)


def _by_name(groups: Sequence[type[ParameterSet]]) -> dict[str, Specification]:
    return {s.name: s for group in groups for s in group.specifications() if s.name not in _NOT_TAKEN}


def _flat(content: Mapping[str, Any], headings: set[str]) -> list[tuple[str, Any]]:
    """Names with underscores and their values; those in the table of a set as if they stood alone."""
    found: list[tuple[str, Any]] = []
    for name, value in content.items():
        if isinstance(value, dict) and name in headings:
            found += [(str(inner).replace("-", "_"), v) for inner, v in value.items()]
        else:
            found.append((str(name).replace("-", "_"), value))
    return found


def _checked(path: Path, specification: Specification, value: Any) -> Any:
    if value is None and specification.automatic:
        value = AUTO
    try:
        return specification.check(value)
    except ParameterError as error:
        raise ParameterError(f"In {path} {_short(str(error))}") from None


def _short(sentence: str) -> str:
    return sentence if len(sentence) <= 2 * _SHOWN else f"{sentence[:_SHOWN]} … {sentence[-_SHOWN:]}"


def _check_profile(path: Path, profile: Any) -> None:
    if profile and (not isinstance(profile, str) or profile not in PROFILES):
        raise ParameterError(f"In {path} profile is {_short(repr(profile))}; give one of {', '.join(PROFILES)}")


def _unknown(path: Path, name: str, known: Mapping[str, Specification]) -> str:
    if name in _NOT_TAKEN:
        return f"{path} has {name}, which is not taken from a file; give it with the run itself"
    close = difflib.get_close_matches(name, known, 1)
    remedy = f"it may mean {close[0]}" if close else "leave it out"
    return f"{path} has {_short(name)}, which is no setting of this command; {remedy}"
