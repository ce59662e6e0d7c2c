"""Fixtures that the tests of refusals share."""

from slopewatch.tests.builders.clouds import las_file
from slopewatch.tests.builders.damaged_clouds import las, laz
from slopewatch.tests.builders.epoch_pairs import first, risen, watched

__all__ = ["first", "las", "las_file", "laz", "risen", "watched"]
