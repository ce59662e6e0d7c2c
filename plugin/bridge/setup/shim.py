"""How the environment finds the engine's code: it is the plugin's own folder, wherever that is.

The environment has a package ``slopewatch`` of one file, whose path leads to the plugin. A search path (.pth) to the
folder above would let the engine import all other plugins; a copy could be another version than the plugin.
"""

from __future__ import annotations

from pathlib import Path

VARIABLE = "SLOPEWATCH_FOLDER"
"""Names the plugin's folder; the plugin sets it for each run, so that a profile may move."""

_TEXT = '''"""The engine's code is in the folder of the QGIS plugin SlopeWatch; this package only leads there."""

import importlib
import os
from pathlib import Path

_named = os.environ.get("{variable}", "")
_kept = Path(__file__).with_name("folder.txt")
_folder = Path(_named or _kept.read_text(encoding="utf-8").strip())
if not (_folder / "metadata.txt").is_file():
    raise ImportError(
        f"SlopeWatch's plugin is no longer in {{_folder}}; run the algorithm Set up engine in QGIS, or name the "
        "plugin's folder in {variable}."
    )
__path__ = [str(_folder)]


def __getattr__(name):
    if name == "api":
        return importlib.import_module(".api", __name__)
    raise AttributeError(f"module {{__name__!r}} has no attribute {{name!r}}")
'''


def write(packages: Path, plugin: Path) -> None:
    """Put the package into an environment's packages, or point one that is there to ``plugin``."""
    folder = packages / "slopewatch"
    folder.mkdir(exist_ok=True)
    (folder / "__init__.py").write_text(_TEXT.format(variable=VARIABLE), encoding="utf-8")
    (folder / "folder.txt").write_text(f"{plugin}\n", encoding="utf-8")
