"""Masks painted by a brush in Label Studio: its run lengths, packed bit by bit, to an array.

The format is that of @thi.ng/rle-pack, which Label Studio's editor uses: the number of words in 32 bits, the bits of a
word less one in 5, four bit counts of run lengths less one in 4 each. Then, until all words are there: one bit that
says whether a run repeats one word, two bits that choose a bit count, the run's length less one in so many bits, and
its word, or its words. The words are the red, green, blue and opacity of the pixels, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool

BANDS = 4
OPAQUE = 128
"""Opacity from which a pixel is painted: half, as at a brush's soft edge."""
_COUNT_BITS, _WORD_BITS, _SIZE_BITS, _SIZES = 32, 5, 4, 4


class MaskError(ValueError):
    """The run lengths are no mask of the picture's size."""


def brush_mask(packed: Sequence[int], height: int, width: int) -> Bool:
    """Painted pixels (height, width).

    Args:
        packed: bytes, as numbers, of a region's ``rle``.

    Raises:
        MaskError: they are damaged, or of a picture of another size.
    """
    words = unpacked(packed, height * width * BANDS)
    return np.asarray(words.reshape(height, width, BANDS)[..., BANDS - 1] >= OPAQUE)


def unpacked(packed: Sequence[int], count: int) -> NDArray[np.unsignedinteger]:
    """The words (count,).

    Raises:
        MaskError: the bytes end early, or hold another number of words.
    """
    try:
        bits = np.unpackbits(np.asarray(packed, dtype=np.uint8))
    except (TypeError, ValueError, OverflowError) as error:
        raise MaskError("its run lengths are no bytes") from error
    text = "".join(map(str, bits.tolist()))
    place = 0

    def read(size: int) -> int:
        nonlocal place
        place += size
        if place > len(text):
            raise MaskError("its run lengths end early")
        return int(text[place - size : place], 2)

    if read(_COUNT_BITS) != count:
        raise MaskError("its run lengths are those of a picture of another size")
    word = read(_WORD_BITS) + 1
    sizes = [read(_SIZE_BITS) + 1 for _ in range(_SIZES)]
    weights = 1 << np.arange(word - 1, -1, -1, dtype=np.uint32)
    out = np.zeros(count, dtype=np.uint8 if word <= 8 else np.uint32)
    done = 0
    while done < count:
        repeated, length = read(1), 1 + read(sizes[read(2)])
        end = done + length
        if end > count:
            raise MaskError("its run lengths are too long")
        if repeated:
            out[done:end] = read(word)
        else:
            place += length * word
            if place > len(text):
                raise MaskError("its run lengths end early")
            out[done:end] = bits[place - length * word : place].reshape(length, word) @ weights
        done = end
    return out
