"""Write scripts/setup/requirements.lock anew from pyproject.toml: the exact versions that `make setup` installs.

Needs `uv` on PATH. Python 3.10 is resolved by itself, all newer ones together, so that every supported machine with
Python 3.11 or newer runs the same versions. The packages that PyTorch's CUDA build asks for are left out: the set-up
takes the CPU build, and a version that is not installed needs no pin. Each version has the SHA-256 of all its files on
PyPI, so that the set-up installs these files and no others.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "scripts" / "setup" / "requirements.lock"
HEADER = "# Made by scripts/update_lock.py from pyproject.toml (all extras); do not edit by hand.\n"
BUILD_TOOLS = "setuptools>=77\nwheel\n"
NOT_PINNED = ("cuda-", "nvidia-", "triton")


def resolve(python: str) -> dict[str, tuple[str, str]]:
    """Resolve pyproject.toml for ``python`` and newer: name -> (version, marker)."""
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


if __name__ == "__main__":
    LOCK.write_text(HEADER + with_hashes(merge(resolve("3.10"), resolve("3.11"))), encoding="utf-8")
    sys.stdout.write(f"wrote {LOCK}\n")
