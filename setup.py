"""The list of packages, which pyproject.toml cannot find by itself where the root of the repository is the package."""

from setuptools import find_packages, setup

PARTS = ("cli", "engine", "interface", "models", "plugin", "processing_algorithms", "simulation", "workflows")

FOUND = find_packages(".", include=[pattern for part in PARTS for pattern in (part, f"{part}.*")])

setup(packages=["slopewatch", *(f"slopewatch.{name}" for name in FOUND)])
