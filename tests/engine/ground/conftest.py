"""Fixtures that the tests of the ground extraction share."""

from slopewatch.tests.builders.extracted_ground import inputs, pair, result

__all__ = ["inputs", "pair", "result"]
