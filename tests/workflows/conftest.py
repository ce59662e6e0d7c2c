"""Fixtures that the tests of the workflows share."""

from slopewatch.tests.builders.networks import small_scene, torch
from slopewatch.tests.builders.series_clouds import runs, simulated
from slopewatch.tests.builders.steep_pair import pair

__all__ = ["pair", "runs", "simulated", "small_scene", "torch"]
