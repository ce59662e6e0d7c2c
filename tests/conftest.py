"""For all tests: the package `slopewatch` is this checkout, and real clouds lie next to it where there are any."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"


def _register_package() -> None:
    """Make `slopewatch` importable under its name from this checkout, whatever folder the checkout lies in."""
    spec = importlib.util.spec_from_file_location(
        "slopewatch", ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"{ROOT} holds no package")
    module = importlib.util.module_from_spec(spec)
    sys.modules["slopewatch"] = module
    spec.loader.exec_module(module)


# Sentences are compared in English, whatever the language of the machine.
os.environ["SLOPEWATCH_LANGUAGE"] = "en"

if "slopewatch" not in sys.modules:
    _register_package()


@pytest.fixture(scope="session")
def root() -> Path:
    """The root of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real point clouds from public projects; a test that needs it is skipped without it."""
    if not DATA.is_dir():
        pytest.skip(f"real point clouds are not next to the checkout ({DATA})")
    return DATA
