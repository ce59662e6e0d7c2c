"""The set-up's bash functions, run against a scratch checkout whose scripts are this one's."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

PARTS = ("common", "pdal", "engine", "qgis", "profile")
Shell = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def checkout(tmp_path: Path, root: Path) -> Path:
    """A folder that stands for a checkout (with a blank in its name); its state is empty."""
    folder = tmp_path / "a checkout"
    folder.mkdir()
    (folder / "scripts").symlink_to(root / "scripts")
    (folder / "metadata.txt").write_text("[general]\n", encoding="utf-8")
    return folder


@pytest.fixture
def shell(checkout: Path, tmp_path: Path) -> Shell:
    """Run a bash script after the set-up's functions were read, with only the system's programs on PATH."""

    def run(script: str, *, path: str = "", **variables: str) -> subprocess.CompletedProcess[str]:
        sources = "".join(f'. "$SLOPEWATCH_ROOT/scripts/setup/{part}.sh"\n' for part in PARTS)
        environment = {
            "PATH": f"{path}:/usr/bin:/bin" if path else "/usr/bin:/bin",
            "HOME": str(tmp_path / "home"),
            "TMPDIR": str(tmp_path),
            "SLOPEWATCH_ROOT": str(checkout),
            "LANG": "C.UTF-8",
            **variables,
        }
        return subprocess.run(
            ["bash", "-c", f"set -euo pipefail\n{sources}{script}"],
            env=environment,
            cwd=os.sep,
            text=True,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=600,
            check=False,
        )

    return run
