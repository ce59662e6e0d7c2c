"""Linux, Windows and macOS: nothing of one system is used where the others would fail, and the workflow tests all."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from slopewatch.tests.builders.walk import ROOT, nodes_in, text_of

SHIPPED = (
    "api",
    "interface",
    "engine",
    "models",
    "simulation",
    "workflows",
    "cli",
    "library",
    "plugin",
    "processing_algorithms",
)
POSIX_MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "pty", "posix"}
POSIX_NAMES = {
    *("killpg", "setsid", "setpgid", "getpgid", "fork", "forkpty", "geteuid", "getuid", "mkfifo", "chown", "nice"),
    *("SIGKILL", "SIGHUP", "SIGALRM", "SIGUSR1", "setitimer", "alarm", "pthread_kill", "preexec_fn"),
}
POSIX_PLACES = re.compile(r"^/(tmp|bin|usr|dev|proc|etc|var|opt|home|root|Library|Applications)\b")
# Each with what keeps it from the other systems.
EXCEPTIONS = {
    "interface/file_lock.py": "falls back to msvcrt where there is no fcntl",
    "engine/core/child_launcher.py": "only started on POSIX systems",
    "engine/core/child_process.py": "/proc, where there is none the answer is 0",
    "engine/core/cancellation.py": "asks for os.name, hasattr",
    "engine/core/part_folders.py": "only of folders with the sticky bit, which Windows does not have",
    "engine/core/temporary_folders.py": "asks for os.name",
    "engine/core/qgis_program.py": "asks for sys.platform",
    "engine/pointcloud/pdal_places.py": "places of macOS and Linux, in functions for these",
    "plugin/bridge/engine_process.py": "asks for sys.platform",
    "plugin/bridge/setup/children.py": "asks for os.name",
    "plugin/bridge/setup/pythons.py": "places of macOS and Linux, in functions for these",
}


def breaches(text: str) -> Iterator[str]:
    for node in nodes_in(text):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in POSIX_MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module in POSIX_MODULES:
            yield str(node.module)
        elif isinstance(node, ast.Attribute) and node.attr in POSIX_NAMES:
            yield node.attr
        elif isinstance(node, ast.keyword) and node.arg in POSIX_NAMES:
            yield node.arg
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and POSIX_PLACES.match(node.value):
            yield node.value


def sources() -> Iterator[tuple[str, str]]:
    for folder in SHIPPED:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path.relative_to(ROOT).as_posix(), text_of(path)


def test_what_only_posix_systems_have_is_used_where_that_is_asked_for() -> None:
    found = {path: sorted(set(breaches(text))) for path, text in sources()}
    assert len(found) > 300
    assert {path: names for path, names in found.items() if names and path not in EXCEPTIONS} == {}
    assert [path for path in EXCEPTIONS if not found[path]] == [], "no longer an exception"


MAKES_TEMPORARY_FILES = {
    "engine/core/temporary_folders.py": "for all others",
    "engine/core/part_folders.py": "folders of outputs, beside the outputs",
    "engine/core/staged_outputs.py": "tries whether a folder of outputs can be written",
}


def imports_tempfile(text: str) -> bool:
    nodes = nodes_in(text)
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return "tempfile" in names | {node.module for node in nodes if isinstance(node, ast.ImportFrom)}


def test_temporary_files_are_made_in_one_place() -> None:
    """There they are locked, and removed by the next run if theirs is killed."""
    assert {path for path, text in sources() if imports_tempfile(text)} == set(MAKES_TEMPORARY_FILES)
    assert imports_tempfile("def f():\n    from tempfile import mkdtemp")


def test_no_child_of_the_plugin_or_the_engine_opens_a_console_on_windows() -> None:
    """QProcess hides it by itself; each Popen and run must be given CREATE_NO_WINDOW."""
    for path, text in sources():
        for node in nodes_in(text):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("subprocess.Popen", "subprocess.run"):
                flags = next((ast.unparse(k.value) for k in node.keywords if k.arg == "creationflags"), "")
                hidden = flags in ("getattr(subprocess, 'CREATE_NO_WINDOW', 0)", "_HIDDEN", "NO_WINDOW")
                assert hidden, f"{path}:{node.lineno}"


@pytest.mark.parametrize(
    "text",
    [
        "import fcntl",
        "from resource import setrlimit",
        "os.killpg(1, 9)",
        "x = '/tmp/x'",
        "Popen(a, preexec_fn=f)",
        "signal.SIGKILL",
    ],
)
def test_the_rule_sees_a_breach(text: str) -> None:
    assert len(list(breaches(text))) == 1


def test_the_workflow_tests_all_three_systems() -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML is in the lock")
    path = ROOT / ".github" / "workflows" / "tests.yml"
    text = text_of(path)
    jobs = yaml.safe_load(text)["jobs"]
    assert set(jobs) == {"check", "engine", "pdal", "qgis"}
    systems = [name.partition("-")[0] for name in jobs["engine"]["strategy"]["matrix"]["os"]]
    assert systems == ["ubuntu", "windows", "macos"]
    steps = [step for job in jobs.values() for step in job["steps"]]
    actions = [step["uses"] for step in steps if "uses" in step]
    assert actions
    pinned = r"(actions/[a-z-]+|mamba-org/setup-micromamba)@v\d+\.\d+\.\d+"
    assert [a for a in actions if not re.fullmatch(pinned, a)] == [], "pinned to a version"
    commands = " ".join(step["run"] for step in steps if "run" in step)
    for place in re.findall(r"\b(?:tests|scripts|plugin)/[\w/.]+", commands):
        assert (ROOT / place).exists(), place
    installs = [line for line in commands.split("python -m ") if line.startswith("pip install")]
    assert all("--require-hashes" in line or "-e" in line for line in installs)
    for word in ("make check", "make test-plugin", "pytest", "slopewatch.cli check"):
        assert word in commands


def test_the_lock_of_the_workflow_is_the_rest_of_the_large_one() -> None:
    from slopewatch.scripts.setup import development_lock as module

    printed = module.needed()
    names = {line.partition("==")[0] for line in printed}
    assert names >= {"pytest", "hypothesis", "mypy", "ruff", "import-linter", "setuptools", "psutil"}
    assert not names & {"numpy", "torch", "pytest-qgis"}
