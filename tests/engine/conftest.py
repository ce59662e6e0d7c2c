"""Fixtures that the tests of the engine share."""

from slopewatch.tests.builders.clouds import las_file

__all__ = ["las_file"]
