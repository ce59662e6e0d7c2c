"""What has been built: a small JSON file that names the environment in use, replaced in one step."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from dataclasses import asdict, dataclass, fields
from enum import Enum
from pathlib import Path

from . import places

FORMAT = 1


@dataclass(frozen=True)
class State:
    """What is in use. ``environment`` and ``screening`` are names of folders next to the file, "" for none.

    ``lock`` and ``screening_lock`` are the SHA-256 of the locks that they were built from; ``missing`` are optional
    packages that have no build for this Python; ``base`` is the Python that the environment was made from.
    """

    environment: str
    lock: str
    plugin: str
    python: str
    base: str
    missing: tuple[str, ...] = ()
    screening: str = ""
    screening_lock: str = ""


class Condition(Enum):
    """Of the engine that the set-up built, for this plugin."""

    READY = "ready"
    MISSING = "missing"
    OUTDATED = "outdated"
    BROKEN = "broken"


def digest(path: Path) -> str:
    """SHA-256 of a text file, whatever its line ends."""
    return hashlib.sha256(path.read_bytes().replace(b"\r\n", b"\n")).hexdigest()


def read(root: Path) -> State | None:
    """The state in a data folder; None where there is none that can be used."""
    try:
        found = json.loads((root / places.STATE).read_text(encoding="utf-8"))
        if found.pop("format") != FORMAT:
            return None
        missing = tuple(str(name) for name in found.pop("missing"))
        known = {field.name for field in fields(State)} - {"missing"}
        texts = {name: value for name, value in found.items() if name in known and isinstance(value, str)}
        state = State(missing=missing, **texts)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    sound = _is_own(state.environment, places.ENVIRONMENT) and (
        not state.screening or _is_own(state.screening, places.SCREENING)
    )
    return state if sound else None


def write(root: Path, state: State) -> None:
    """Make ``state`` the one in use, in one step."""
    new = root / (places.STATE + ".new")
    new.write_text(json.dumps({"format": FORMAT, **asdict(state)}, indent=2) + "\n", encoding="utf-8")
    os.replace(new, root / places.STATE)


def interpreter(root: Path, state: State) -> Path:
    """The interpreter of the environment in use."""
    return Path(places.interpreter_in(root / state.environment, sys.platform))


def condition(root: Path, lock: Path, version: str) -> Condition:
    """Whether the engine stands for the plugin of this lock and version. Starts nothing."""
    state = read(root)
    if state is None:
        return Condition.MISSING
    python = interpreter(root, state)
    if not python.is_file() or not _home_of(root / state.environment).is_dir() or _is_another(python, state.python):
        return Condition.BROKEN
    # the environment of a newer plugin, of another profile, serves this one too
    if state.lock != digest(lock) and _numbers(state.plugin) <= _numbers(version):
        return Condition.OUTDATED
    return Condition.READY


def _home_of(environment: Path) -> Path:
    """The folder of the Python that a virtual environment was made from."""
    try:
        for line in (environment / "pyvenv.cfg").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition("=")
            if name.strip() == "home":
                return Path(value.strip())
    except (OSError, ValueError):
        pass
    return environment / "no home"


def _is_another(python: Path, version: str) -> bool:
    """Whether an environment's interpreter leads to another Python now, as after an upgrade of the system.

    Known where it is a link to a program with its version in its name; its packages are not found then.
    """
    found = re.fullmatch(r"python(\d+\.\d+)", Path(os.path.realpath(python)).name)
    return found is not None and found[1] != ".".join(version.split(".")[:2])


def _numbers(version: str) -> list[int]:
    return [int(part) if part.isdigit() else 0 for part in version.split(".")]


def _is_own(name: str, start: str) -> bool:
    """Whether it is the name of a folder that the set-up makes, and leads nowhere else."""
    return name.startswith(start) and name[len(start) :].isalnum()
