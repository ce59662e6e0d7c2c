"""A small bare slope whose ground moves along itself."""

from __future__ import annotations

import math

import numpy as np
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.motion.moved_ground import SurfaceMotion
from slopewatch.simulation.motion.placing import motions_on
from slopewatch.simulation.surveys.scene import Relief, Scene, build_scene, cut_profile

HEIGHT_M, ANGLE = 16.0, 39.0
RUN_M = HEIGHT_M / math.tan(math.radians(ANGLE))
SLOPE = (0.0, 0.0, 24.0, RUN_M)
RELIEF = Relief()


def bare_slope(seed: int = 1) -> Scene:
    """The slope at rest, without grass."""
    relief = Relief(turf_height=0.0)
    profile = cut_profile(HEIGHT_M, ANGLE, 0)
    return build_scene(profile, SLOPE, 6.0, Frame(), relief, np.random.default_rng(seed))


def moving(kind: str, amount: float) -> SurfaceMotion:
    """The motion of the kind in the middle of ``bare_slope``."""
    profile = cut_profile(HEIGHT_M, ANGLE, 0)
    return motions_on((profile.v, profile.z), SLOPE, (kind,), amount)[0]
