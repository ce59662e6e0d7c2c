"""What the tests of the models share: one thread, so that they take the same time and give the same numbers
everywhere.
"""

from __future__ import annotations

import pytest
from slopewatch.simulation.hazard_scenes.scenes import scene


@pytest.fixture
def torch():
    """torch with one thread; the test is skipped where torch or safetensors is missing."""
    reason = "torch and safetensors are not installed; install slopewatch[screening]"
    module = pytest.importorskip("torch", reason=reason)
    pytest.importorskip("safetensors", reason=reason)
    threads = module.get_num_threads()
    module.set_num_threads(1)
    yield module
    module.set_num_threads(threads)


@pytest.fixture(scope="session")
def small_scene():
    """A slope of about 500 m² and 20 thousand points with hazards."""
    return scene(1_000_011, "published", area=500.0, density=40.0)
