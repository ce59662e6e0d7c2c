"""Numbers as people read them: no signed zero, no error that is rounded to nothing."""

from __future__ import annotations

import pytest
from slopewatch.engine.core.json_values import plain
from slopewatch.engine.core.number_text import fixed
from slopewatch.engine.report.figures import Figures


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [(-0.0004, 3, "0.000"), (0.0, 2, "0.00"), (-0.0, 0, "0"), (-0.0006, 3, "-0.001"), (1234.5, 1, "+1234.5")],
)
def test_what_rounds_to_zero_has_no_sign(value: float, digits: int, shown: str) -> None:
    assert fixed(value, digits, sign=True) == shown


def test_negative_digits_round_before_the_point() -> None:
    assert fixed(-1237.0, -1, grouped=True) == "-1,240"


def test_a_figure_with_its_error_never_reads_as_exactly_nothing() -> None:
    figures = Figures({"value": 0.0, "small": 0.0031, "error": 0.0042, "none": 0.0, "least": 1e-15})

    def shown(value: str, error: str) -> str:
        text = figures.with_error((value,), (error,), unit="m³", digits=2)
        return "".join(part.split(">")[-1] for part in text.split("<")).replace("&nbsp;", " ")

    assert shown("small", "error") == "0.0031 ± 0.0042 m³"
    assert shown("value", "error") == "0.0000 ± 0.0042 m³"
    assert shown("value", "none") == "0.00 m³"
    assert "±" not in shown("value", "least")


def test_records_and_terminals_know_no_minus_zero() -> None:
    assert str(plain({"dz": [-0.0]})["dz"][0]) == "0.0"
