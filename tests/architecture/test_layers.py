"""The layers of the packages, as the contracts in pyproject.toml say."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def lint(tmp_path):
    """Runs lint-imports on a folder that holds the package `slopewatch`; its exit code and what it says."""
    pytest.importorskip("importlinter", reason="import-linter is not installed; install slopewatch[dev]")

    def run(package: Path) -> tuple[int, str]:
        (tmp_path / "path").mkdir()
        (tmp_path / "path" / "slopewatch").symlink_to(package, target_is_directory=True)
        command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--config", ROOT / "pyproject.toml"]
        environment = {"PYTHONPATH": str(tmp_path / "path"), "PATH": "/usr/bin:/bin"}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
        return done.returncode, done.stdout + done.stderr

    return run


def test_packages_import_only_from_below(lint):
    code, said = lint(ROOT)
    assert "0 broken" in said, said
    assert code == 0
    contracts = (ROOT / "pyproject.toml").read_text(encoding="utf-8").count("[[tool.importlinter.contracts]]")
    assert f"{contracts} kept" in said
    assert contracts >= 7
