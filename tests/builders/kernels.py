"""Both ways of a kernel on the same input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from slopewatch.engine.core.compiled import Kernel, compiled_loop


def assert_equal_ways(kernel: Kernel[..., NDArray[Any]], *arguments: Any) -> NDArray[Any]:
    """Assert that the loop, compiled where numba is and else run by Python, gives the plain way's bits; give these."""
    expected = kernel.plain(*arguments)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (compiled_loop(kernel.loop) or kernel.loop)(*arguments)
    assert found.shape == expected.shape
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)
    return expected
