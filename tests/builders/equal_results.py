"""Results compared to the last bit, whatever they are made of."""

from __future__ import annotations

from dataclasses import fields

import numpy as np


def same(one: object, other: object, where: str = "result") -> None:
    """Arrays, and dataclasses and tuples of them, are equal to the last bit."""
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other, err_msg=where)
    elif hasattr(one, "__dataclass_fields__"):
        for f in fields(one):
            same(getattr(one, f.name), getattr(other, f.name), f"{where}.{f.name}")
    elif isinstance(one, tuple):
        for number, (a, b) in enumerate(zip(one, other, strict=True)):
            same(a, b, f"{where}[{number}]")
    else:
        assert one == other, where
