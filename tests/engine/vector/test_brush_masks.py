"""Masks of Label Studio's brush: vectors of its own converter, and what is packed comes back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slopewatch.engine.vector.brush_masks import MaskError, brush_mask, unpacked
from slopewatch.tests.builders.label_studio import packed, painted

# made with encode_rle of label-studio-converter 0.0.59 from a mask whose four bands are the opacity, 4 x 5 pixels
SOFT = [0, 0, 0, 80, 57, 27, 252, 108, 152, 76, 2, 223, 252, 224, 22, 255, 240, 152, 4, 121, 0]
# ... and from 2 x 3 pixels of random bytes, whose opacities are OPACITY
NOISY = [
    0, 0, 0, 24, 57, 27, 248, 31, 224, 114, 0, 68, 3, 200, 30, 96, 94, 128, 12, 4, 24, 12, 192, 84, 0, 164, 6, 8, 23,
    96, 75, 0, 162, 7, 152, 25, 160, 12, 1, 216, 0, 64, 30, 192, 82, 1, 206, 1, 32,
]  # fmt: skip
OPACITY = [[121, 131, 193], [243, 8, 36]]


def test_masks_of_label_studio_s_converter():
    wanted = np.zeros((4, 5), dtype=bool)
    wanted[1:3, 1:4] = wanted[3, 4] = True  # an opacity of 100 in the corner is less than half
    np.testing.assert_array_equal(brush_mask(SOFT, 4, 5), wanted)
    np.testing.assert_array_equal(unpacked(NOISY, 24).reshape(2, 3, 4)[..., 3], OPACITY)


@settings(deadline=None, max_examples=80)
@given(
    st.lists(st.tuples(st.integers(0, 255), st.integers(1, 40)), min_size=1, max_size=30),
    st.sampled_from([(3, 4, 8, 16), (1, 2, 3, 4), (5, 6, 7, 8)]),
)
def test_what_is_packed_comes_back(runs, sizes):
    words = [value for value, length in runs for _ in range(length)]
    np.testing.assert_array_equal(unpacked(packed(words, sizes), len(words)), words)


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_masks_come_back(rows, columns, seed):
    mask = np.random.default_rng(seed).random((rows, columns)) < 0.4
    np.testing.assert_array_equal(brush_mask(painted(mask), rows, columns), mask)


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(0, 255), max_size=40), st.integers(1, 9))
def test_any_bytes_are_a_mask_or_refused(data, side):
    try:
        mask = brush_mask(data, side, side)
    except MaskError:
        return
    assert mask.shape == (side, side)


@pytest.mark.parametrize(
    ("data", "count", "words"),
    [
        (SOFT[:-8], 80, "end early"),
        (NOISY[:-3], 24, "end early"),
        (SOFT, 120, "another size"),
        ([300], 4, "no bytes"),
        (["a"], 4, "no bytes"),
        ([], 4, "end early"),
        ([0, 0, 0, 1, *SOFT[4:]], 1, "too long"),
    ],
)
def test_damaged_ones_are_refused(data, count, words):
    with pytest.raises(MaskError, match=words):
        unpacked(data, count)
