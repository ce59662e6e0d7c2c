"""The list of packages, which pyproject.toml cannot find by itself where the root of the repository is the package, and
the version, which QGIS wants in metadata.txt.
"""

import configparser
from pathlib import Path

from setuptools import find_packages, setup

PARTS = (
    "api",
    "cli",
    "engine",
    "interface",
    "library",
    "models",
    "plugin",
    "processing_algorithms",
    "simulation",
    "workflows",
)

FOUND = find_packages(".", include=[pattern for part in PARTS for pattern in (part, f"{part}.*")])

METADATA = configparser.ConfigParser(interpolation=None)
METADATA.read(Path(__file__).with_name("metadata.txt"), encoding="utf-8")

setup(version=METADATA["general"]["version"], packages=["slopewatch", *(f"slopewatch.{name}" for name in FOUND)])
