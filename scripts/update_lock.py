"""Write scripts/setup/requirements.lock anew from pyproject.toml: the exact versions that `make setup` installs.

Needs `uv` on PATH. Python 3.10 is resolved by itself, all newer ones together, so that every supported machine with
Python 3.11 or newer runs the same versions. The packages that PyTorch's CUDA build asks for are left out: the set-up
takes the CPU build, and a version that is not installed needs no pin. Each version has the SHA-256 of all its files on
PyPI, so that the set-up installs these files and no others.

`python scripts/update_lock.py keep` adds what pyproject.toml asks for in addition and leaves all other versions as they
are.

The two locks in the plugin's zip are parts of it: `python scripts/update_lock.py plugin` writes only these. PyTorch's
build for processors on Linux is not on PyPI: scripts/setup/torch_cpu.lock has the hashes that PyTorch's own index
lists, which are to be renewed by hand with the version.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "scripts" / "setup" / "requirements.lock"
TORCH_CPU = ROOT / "scripts" / "setup" / "torch_cpu.lock"
PLUGIN_LOCKS = ROOT / "plugin" / "bridge" / "setup"
HEADER = "# Made by scripts/update_lock.py from pyproject.toml (all extras); do not edit by hand.\n"
PART_HEADER = "# Made by scripts/update_lock.py: a part of scripts/setup/requirements.lock; do not edit by hand.\n"
BUILD_TOOLS = "pip\nsetuptools>=77\nwheel\n"
INSTALLER = ["pip"]
NOT_PINNED = ("cuda-", "nvidia-", "triton")
ALONE = {"pycsw": ("2.6.2", "")}
"""Locked without what they depend on: of pycsw the tests only take the schemas of ISO 19139."""


def resolve(python: str, *, keep: bool) -> dict[str, tuple[str, str]]:
    """Resolve pyproject.toml for ``python`` and newer: name -> (version, marker). ``keep``: as in the lock."""
    with tempfile.TemporaryDirectory() as folder:
        tools = Path(folder) / "tools.in"
        tools.write_text(BUILD_TOOLS, encoding="utf-8")
        command = [
            "uv",
            "pip",
            "compile",
            "--quiet",
            "--universal",
            "--fork-strategy",
            "fewest",
            "--python-version",
            python,
        ]
        command += ["--all-extras", "--no-header", "--no-annotate", str(ROOT / "pyproject.toml"), str(tools)]
        if keep:
            pins = Path(folder) / "pins.txt"
            versions = re.findall(r"^([a-z0-9.-]+)==([^ ]+)", LOCK.read_text(encoding="utf-8"), flags=re.M)
            side = dict(reversed(versions) if python == "3.10" else versions)  # of two versions the older is the first
            pins.write_text("".join(f"{name}=={version}\n" for name, version in side.items()), encoding="utf-8")
            command += ["--constraint", str(pins)]
        text = subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE).stdout
    found = {}
    for line in text.splitlines():
        requirement, _, marker = (part.strip() for part in line.partition(";"))
        name, _, version = requirement.partition("==")
        if version and not name.startswith(NOT_PINNED):
            found[name] = (version, marker)
    return found


def with_hashes(lines: list[str]) -> str:
    """The lock's text: ``lines``, each with the hashes of all files of its version."""
    with tempfile.TemporaryDirectory() as folder:
        pins = Path(folder) / "pins.in"
        pins.write_text("\n".join(lines) + "\n", encoding="utf-8")
        command = ["uv", "pip", "compile", "--quiet", "--universal", "--no-deps", "--generate-hashes"]
        command += ["--python-version", "3.10", "--no-header", "--no-annotate", str(pins)]
        return subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE).stdout


def merge(old: dict[str, tuple[str, str]], new: dict[str, tuple[str, str]]) -> list[str]:
    """Lines of the lock: one a package where both resolutions agree, else one for each side of Python 3.11."""
    lines = []
    for name in sorted(old | new):
        if old.get(name) == new.get(name):
            sides = [(new[name], "")]
        else:
            sides = [
                (packages[name], condition)
                for packages, condition in (
                    (old, "python_full_version < '3.11'"),
                    (new, "python_full_version >= '3.11'"),
                )
                if name in packages
            ]
        for (version, marker), condition in sides:
            conditions = dict.fromkeys((condition, marker))  # the same twice says no more
            markers = " and ".join(f"({part})" if " or " in part else part for part in conditions if part)
            lines.append(f"{name}=={version}" + (f" ; {markers}" if markers else ""))
    return lines


def entries(text: str) -> list[tuple[str, str]]:
    """Name and whole text of each entry of a lock."""
    found = re.findall(r"^[a-z0-9][^\n]*(?:\n[ ]+[^\n]*)*\n", text, flags=re.M)
    return [(entry.partition("==")[0], entry) for entry in found]


def names_of(*extras: str) -> set[str]:
    """Names of all packages that the project needs with these extras, on any system and Python."""
    command = [
        "uv",
        "pip",
        "compile",
        "--quiet",
        "--universal",
        "--no-header",
        "--no-annotate",
        "--python-version",
        "3.10",
    ]
    command += [*(f"--extra={extra}" for extra in extras), str(ROOT / "pyproject.toml")]
    text = subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE).stdout
    return {line.partition("==")[0] for line in text.splitlines() if "==" in line}


def write_plugin_locks() -> None:
    """The locks of the engine and of the screening's network, as parts of the large one; pip first."""
    every = entries(LOCK.read_text(encoding="utf-8"))
    engine = names_of("compiled", "pdf", "postgis")
    screening = names_of("compiled", "pdf", "postgis", "screening") - engine
    parts = [entry for name, entry in every if name in INSTALLER] + [entry for name, entry in every if name in engine]
    (PLUGIN_LOCKS / "engine.lock").write_text(PART_HEADER + "".join(parts), encoding="utf-8")
    parts = [entry for name, entry in every if name in screening and name != "torch"]
    (elsewhere,) = (entry for name, entry in every if name == "torch")
    elsewhere = elsewhere.replace(" \\\n", " ; sys_platform != 'linux' \\\n", 1)
    cpu = "".join(entry for _, entry in entries(TORCH_CPU.read_text(encoding="utf-8")))
    (PLUGIN_LOCKS / "screening.lock").write_text(PART_HEADER + "".join(parts) + elsewhere + cpu, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] != ["plugin"]:
        older, newer = (resolve(python, keep=sys.argv[1:] == ["keep"]) | ALONE for python in ("3.10", "3.11"))
        LOCK.write_text(HEADER + with_hashes(merge(older, newer)), encoding="utf-8")
    write_plugin_locks()
    sys.stdout.write(f"wrote {LOCK} and its parts in {PLUGIN_LOCKS}\n")
