"""Digits of figures against the decimal module's rounding to significant digits."""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Context, Decimal

import numpy as np
import pytest
from slopewatch.interface.rounding import digits_of_error, significant_decimals

TWO_DIGITS = Context(prec=2, rounding=ROUND_HALF_EVEN)


@pytest.mark.parametrize(
    ("error", "digits"),
    [(0.0412, 3), (0.33, 2), (0.0996, 2), (0.0949, 3), (1.0, 1), (9.96, 0), (12.4, 0), (340.0, -1), (1e-9, 6)],
)
def test_an_error_has_two_significant_digits(error: float, digits: int) -> None:
    assert digits_of_error(error) == digits


def test_the_decimal_module_rounds_errors_to_the_same_figures() -> None:
    for error in 10.0 ** np.random.default_rng(4).uniform(-3, 4, 500):
        shown = round(float(error), digits_of_error(float(error)))
        assert Decimal(repr(shown)) == pytest.approx(TWO_DIGITS.create_decimal_from_float(float(error)))


@pytest.mark.parametrize(
    ("value", "decimals"), [(9.86, 1), (27.9, 0), (0.0, 0), (-0.5, 2), (156.0, 0), (float("nan"), 0)]
)
def test_a_figure_without_an_error_has_two_digits(value: float, decimals: int) -> None:
    assert significant_decimals(value) == decimals
