"""One unit for the rates that stand together."""

from __future__ import annotations

from typing import Any

import pytest
from slopewatch.interface.rates import rate_unit


@pytest.mark.parametrize(
    ("rates", "unit"),
    [
        ([0.033], "mm/month"),  # 12.05 mm a year
        ([0.0328], "mm/year"),  # 0.998 mm a month
        ([0.001, -0.5, None], "mm/month"),
        ([float("nan"), -0.01], "mm/year"),
        ([], "mm/year"),
    ],
)
def test_the_fastest_rate_decides_on_the_unit(rates: list[Any], unit: str) -> None:
    assert rate_unit(rates).name == unit


def test_a_rate_in_either_unit_is_the_same_way() -> None:
    month, year = rate_unit([1.0]), rate_unit([0.0])
    assert month.days * 12 == pytest.approx(365.25)
    assert year.days == pytest.approx(365.25)
