"""Libraries of linear algebra on one thread, and again on as many as before."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.blas_threads import one_blas_thread
from threadpoolctl import threadpool_info, threadpool_limits


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_one_thread_within_the_block_and_the_former_ones_behind_it():
    np.linalg.solve(np.eye(3), np.ones(3))
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("numpy's linear algebra has one thread here")
        for _ in range(2):
            with one_blas_thread():
                assert threads() == {1}
            assert threads() == {2}
