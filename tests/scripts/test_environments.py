"""The Python environments: kept while they are whole, made anew where an install was cut short or the folder moved."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def bare_environment(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bare") / "venv"
    subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=600)
    return folder


def kept(shell, venv: Path) -> bool:
    """Whether the set-up keeps ``venv``: a file of the user's in it tells."""
    mark = venv / "mark"
    mark.touch()
    result = shell(f'fresh_environment "{venv}" "{sys.executable}" --without-pip')
    assert result.returncode == 0, result.stderr
    assert (venv / "bin" / "python").exists()
    assert (venv / ".unfinished").exists(), "marked until its packages are in"
    return mark.exists()


@pytest.fixture
def environment(bare_environment: Path):
    yield bare_environment
    (bare_environment / ".unfinished").unlink(missing_ok=True)


def test_a_whole_environment_is_kept(shell, environment):
    assert kept(shell, environment)


def test_an_environment_whose_install_was_cut_short_is_made_anew(shell, environment, tmp_path):
    copy = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", copy], check=True, timeout=600)
    assert not kept(shell, copy), "it has no pip"
    (environment / ".unfinished").touch()
    assert shell(f'is_environment_whole "{environment}"').returncode == 0
    moved = tmp_path / "moved"
    shutil.copytree(environment, moved, symlinks=True)
    (moved / ".unfinished").unlink()
    assert not kept(shell, moved), "its scripts still name the old place"


def test_an_unfinished_environment_is_made_anew(shell, environment, tmp_path):
    (environment / ".unfinished").touch()
    mark = environment / "mark"
    mark.touch()
    script = f'rm() {{ echo "rm $*"; exit 7; }}\nfresh_environment "{environment}" "{sys.executable}"'
    result = shell(script)
    assert result.returncode == 7
    assert "cut short" in result.stdout
    assert f"rm -rf {environment}" in result.stdout


@pytest.mark.parametrize(("version", "found"), [("3.9.18", False), ("3.10.0", True), ("3.13.5", True)])
def test_only_a_python_that_is_new_enough_is_taken(shell, tmp_path, version, found):
    program = tmp_path / "bin" / "python3"
    program.parent.mkdir()
    program.write_text(
        f'#!/bin/sh\ncase $2 in *version_info*) echo {version} ;; *) echo "$0" ;; esac\n', encoding="utf-8"
    )
    program.chmod(0o755)
    result = shell("find_python", path=str(program.parent))
    assert (result.stdout.strip() == str(program)) is found


def test_without_pytorch_the_set_up_goes_on_and_says_so(shell, checkout):
    script = 'pip_in() { echo "$*" >>"$ROOT/asked"; return 1; }\nmkdir -p "$STATE"\nsetup_torch\n'
    first = shell(script)
    assert first.returncode == 0
    assert "screening by points are off" in first.stdout
    asked = (checkout / "asked").read_text(encoding="utf-8")
    assert "torch_cpu.lock" in asked, "never the plain name, which brings CUDA"
    assert "--require-hashes" in asked
    assert "download.pytorch.org/whl/cpu" in asked
    second = shell(script)
    assert second.returncode == 0
    assert "scripts/setup.sh torch" in second.stdout
    assert (checkout / "asked").read_text(encoding="utf-8") == asked, "the second run asks the network for nothing"


@pytest.mark.parametrize(
    ("version", "kept"), [("2.5.1", False), ("2.6.0", True), ("2.14.1+cpu", True), ("2.15.0", False)]
)
def test_a_pytorch_within_the_range_is_used_as_it_is(shell, checkout, version, kept):
    python = checkout / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\ncase "$*" in *torch*) echo {version.partition("+")[0]} ;; esac\n', encoding="utf-8")
    python.chmod(0o755)
    done = shell('pip_in() { echo asked pip; return 1; }\nsetup_torch\ncat "$STATE/torch.log"')
    assert done.returncode == 0, done.stderr
    assert ("is there, used as it is" in done.stdout) is kept
    assert ("asked pip" in done.stdout) is not kept


def test_the_pinned_pytorch_lies_within_the_range_of_the_project(root, shell):
    low, high = shell('echo "$TORCH_OLDEST" "$TORCH_BELOW"').stdout.split()
    assert f'"torch>={low},<{high}"' in (root / "pyproject.toml").read_text(encoding="utf-8")
    assert f"pytorch >={low},<{high}" in (root / "environment.yml").read_text(encoding="utf-8")
    locks = [(root / "scripts" / "setup" / name).read_text("utf-8") for name in ("requirements.lock", "torch_cpu.lock")]
    pinned = {
        line[7:].partition("+")[0].split()[0] for lock in locks for line in lock.splitlines() if line[:7] == "torch=="
    }
    assert len(pinned) == 1
    assert shell(f"version_at_least {min(pinned)} {low} && ! version_at_least {min(pinned)} {high}").returncode == 0


def test_every_dependency_is_pinned_and_in_the_conda_file(root):
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has no tomllib")
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lock = (root / "scripts" / "setup" / "requirements.lock").read_text(encoding="utf-8")
    pinned = {line.partition("==")[0] for line in lock.splitlines() if not line.startswith(("#", " "))}
    conda = (root / "environment.yml").read_text(encoding="utf-8")
    names = {name(text) for text in project["dependencies"]}
    groups = {key: group for key, group in project["optional-dependencies"].items() if key != "docs"}
    extras = {name(text) for group in groups.values() for text in group}
    assert names | extras <= pinned
    assert {f"  - {conda_name}" for conda_name in names if f"  - {conda_name} " not in conda} <= {"  - matplotlib"}


def name(requirement: str) -> str:
    return requirement.partition("[")[0].partition(">")[0].partition("=")[0].strip()
