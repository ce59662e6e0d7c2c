"""Fixtures that the tests of the models share."""

from slopewatch.tests.builders.networks import small_scene, torch

__all__ = ["small_scene", "torch"]
