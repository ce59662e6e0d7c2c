"""For tests of the set-up: tiny wheels with their lock, and a plugin whose engine only says its version."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from slopewatch.plugin.bridge.interpreter import child_environment
from slopewatch.plugin.bridge.setup import pythons
from slopewatch.plugin.bridge.setup.network import pip_environment
from slopewatch.plugin.bridge.setup.workshop import Order, Reporter

ROOT = Path(__file__).resolve().parents[2]
ENGINE = """import json, sys
from pathlib import Path
import tiny_one, tiny_two
try:
    import torch
    torch = torch.__file__
except ImportError:
    torch = None
version = (Path(__file__).parents[1] / "metadata.txt").read_text().split("version=")[1].split()[0]
metrics = {"slopewatch": version, "two": tiny_two.VALUE, "torch": torch}
print(json.dumps({"event": "result", "outputs": {}, "metrics": metrics}))
"""


def make_wheel(folder: Path, name: str, version: str, text: str = "VALUE = 1\n", tag: str = "py3-none-any") -> Path:
    """A wheel of one module, the same bytes for the same content."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-{version}-{tag}.whl"
    info = f"{name}-{version}.dist-info"
    files = {
        f"{name}.py": text,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name.replace('_', '-')}\nVersion: {version}\n",
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}\n",
        f"{info}/RECORD": "",
    }
    with zipfile.ZipFile(path, "w") as file:
        for place, content in files.items():
            file.writestr(zipfile.ZipInfo(place, (2026, 1, 1, 0, 0, 0)), content)
    return path


def entry(wheel: Path, marker: str = "") -> str:
    """The lock's entry of a wheel."""
    name, version = wheel.name.split("-")[:2]
    condition = f" ; {marker}" if marker else ""
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    return f"{name.replace('_', '-')}=={version}{condition} \\\n    --hash=sha256:{digest}\n"


def make_plugin(folder: Path, version: str = "1.0.0") -> Path:
    """A plugin's folder with an engine that says its version."""
    (folder / "cli").mkdir(parents=True, exist_ok=True)
    (folder / "metadata.txt").write_text(f"[general]\nversion={version}\n")
    (folder / "cli" / "__init__.py").write_text("")
    (folder / "cli" / "__main__.py").write_text(ENGINE)
    return folder


def make_whole_plugin(folder: Path, index: Path) -> Path:
    """The plugin as it is, with ``make_plugin``'s engine and a lock of two wheels, which are made in ``index``."""
    for name in ("plugin", "processing_algorithms", "interface"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "__init__.py", folder)
    (folder / "lab").symlink_to(ROOT / "lab")  # the sessions that QGIS runs
    make_plugin(folder)
    shutil.copy(ROOT / "metadata.txt", folder)
    wheels = [make_wheel(index, name, "1.0") for name in ("tiny_one", "tiny_two")]
    make_lock(folder / "plugin" / "bridge" / "setup" / "engine.lock", *map(entry, wheels))
    return folder


def make_lock(path: Path, *entries: str) -> Path:
    path.write_text("# A lock.\n" + "".join(entries))
    return path


def make_order(folder: Path, index: Path, lock: Path, **changes: Any) -> Order:
    """An order for ``folder/data`` whose network is the folder ``index``."""
    environ = child_environment()
    running = pythons.Running(sys.platform, sys.executable, sys.prefix, sys.version_info[:2])
    usual = Order(
        root=folder / "data",
        plugin=folder / "plugin",
        version="1.0.0",
        pythons=pythons.candidates(running, os.environ, os.path.isfile),
        environ=environ,
        pip_environ={
            **{k: v for k, v in pip_environment(environ, {}).items() if k != "PIP_EXTRA_INDEX_URL"},
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_NO_INDEX": "1",
            "PIP_FIND_LINKS": str(index),
        },
        engine_lock=lock,
        screening_lock=lock,
        engine_bytes=1,
        screening_bytes=1,
    )
    return replace(usual, **changes)


class Listener:
    """Keeps what a set-up says, and cancels it when its progress says so."""

    def __init__(self, cancel_at: str = "no words at all") -> None:
        self.percents: list[float] = []
        self.words: list[str] = []
        self.warnings: list[str] = []
        self.cancel_at, self.is_cancelled = cancel_at, False

    def reporter(self) -> Reporter:
        return Reporter(self._progress, self.words.append, self.warnings.append, lambda: self.is_cancelled)

    def _progress(self, percent: float, words: str) -> None:
        self.percents.append(percent)
        self.words.append(words)
        self.is_cancelled = self.is_cancelled or words.startswith(self.cancel_at)
