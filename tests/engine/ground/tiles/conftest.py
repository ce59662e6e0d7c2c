"""Fixtures that the tests of the ground in tiles share."""

from slopewatch.tests.builders.clouds import las_file
from slopewatch.tests.builders.long_slope import in_one_piece, in_tiles, long_cloud, long_pair

__all__ = ["in_one_piece", "in_tiles", "las_file", "long_cloud", "long_pair"]
