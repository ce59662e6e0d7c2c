"""Parameters that a caller in Python gave by name, with a profile and a file of settings under them."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar

from ..engine.core.errors import InputError
from ..engine.core.part_folders import settle_around
from ..interface.parameters import PROFILES, OutputParameters, ParameterError, ParameterSet, command_sets
from ..interface.settings_file import GivenSettings, read_settings

Group = TypeVar("Group", bound=ParameterSet)


class Values:
    """The parameters that a caller gave, returned by set."""

    def __init__(self, given: dict[str, Any], sets: command_sets.Sets) -> None:
        self._sets = sets
        profile, path = given.pop("profile", None), given.pop("settings", None)
        read = GivenSettings({}) if path is None else _settings(Path(path), sets)
        self._profile = profile or read.profile or "default"
        known = {s.name for group in sets for s in group.specifications()}
        for name in given:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                meant = f"; did you mean {near[0]}?" if near else "; docs/guide.md lists them."
                raise InputError(f"{name} is no parameter here{meant}")
        if self._profile not in PROFILES:
            raise InputError(f"profile is {self._profile!r}; give one of {', '.join(PROFILES)}.")
        self._given = read.over(sets, self._profile) | given

    @property
    def profile(self) -> str:
        return self._profile

    @property
    def given(self) -> dict[str, Any]:
        """The values by name that were given, by the caller or in the file of settings."""
        return dict(self._given)

    def of(self, group: type[Group]) -> Group:
        """A set; what was given is of the sets of the call, and two sets may have a name in common."""
        own = any(issubclass(one, group) for one in self._sets)
        try:
            return group.build(self._given if own else {}, self._profile)
        except ParameterError as wrong:
            raise InputError(f"{wrong}.") from None

    @property
    def overwrite(self) -> bool:
        return self.of(OutputParameters).overwrite


def _settings(path: Path, sets: command_sets.Sets) -> GivenSettings:
    settle_around(path)
    try:
        return read_settings(path, sets)
    except ParameterError as wrong:
        raise InputError(f"{wrong}.") from None
