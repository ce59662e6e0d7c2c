"""Fixtures that the tests of the laboratory share."""

from slopewatch.tests.builders.networks import small_scene, torch

__all__ = ["small_scene", "torch"]
