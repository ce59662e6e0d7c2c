"""Colours: what each sign looks like, to everybody."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.maps.palette import (
    DIVERGING,
    LIKELIHOOD,
    SEQUENTIAL,
    Colour,
    colour_limit,
    diverging_colours,
    rounded_up,
)

# Machado et al. 2009, table 1: full protanopia and deuteranopia, on linear RGB
PROTAN = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
DEUTAN = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]


def linear(colour: np.ndarray) -> np.ndarray:
    c = np.asarray(colour) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def oklab(rgb: np.ndarray) -> np.ndarray:
    lms = np.cbrt(
        np.array(
            [
                [0.4122214708, 0.5363325363, 0.0514459929],
                [0.2119034982, 0.6806995451, 0.1073969566],
                [0.0883024619, 0.2817188376, 0.6299787005],
            ]
        )
        @ rgb
    )
    return (
        np.array(
            [
                [0.2104542553, 0.7936177850, -0.0040720468],
                [1.9779984951, -2.4285922050, 0.4505937099],
                [0.0259040371, 0.7827717662, -0.8086757660],
            ]
        )
        @ lms
    )


def test_lowering_is_red_and_raising_is_blue() -> None:
    for share in (0.1, 0.3, 0.6, 1.0):
        red, _, blue = diverging_colours(np.array([-share]), 1.0)[0].astype(int)
        assert red > blue + 30
        red, _, blue = diverging_colours(np.array([share]), 1.0)[0].astype(int)
        assert blue > red + 30


def test_stops_are_hit_and_ends_are_held() -> None:
    for share, low, high in DIVERGING:
        got = diverging_colours(np.array([-0.4 * share, 0.4 * share]), 0.4)
        assert np.abs(got.astype(int) - [low, high]).max() <= 1
    ends = diverging_colours(np.array([-9.0, -1.0, 1.0, 9.0]), 1.0)
    assert ends[0].tolist() == ends[1].tolist() == list(DIVERGING[-1][1])
    assert ends[2].tolist() == ends[3].tolist() == list(DIVERGING[-1][2])


def test_both_arms_are_equally_light() -> None:
    for _, low, high in DIVERGING:
        assert oklab(linear(low))[0] == pytest.approx(oklab(linear(high))[0], abs=0.02)


@pytest.mark.parametrize("vision", [PROTAN, DEUTAN], ids=["protan", "deutan"])
def test_signs_stay_apart_in_colour_blindness(vision: list[list[float]]) -> None:
    for share, low, high in DIVERGING:
        if share >= 0.25:
            seen = [oklab(np.clip(np.array(vision) @ linear(c), 0, 1)) for c in (low, high)]
            assert np.linalg.norm(seen[0] - seen[1]) > 0.13


@pytest.mark.parametrize("ramp", [SEQUENTIAL, LIKELIHOOD])
def test_sequential_ramps_darken(ramp: tuple[tuple[float, Colour], ...]) -> None:
    lightness = [oklab(linear(c))[0] for _, c in ramp]
    assert all(np.diff(lightness) < -0.05)


def test_likelihood_has_no_hue_of_a_sign() -> None:
    for _, colour in LIKELIHOOD:
        assert np.abs(oklab(linear(colour))[1:]).max() < 1e-3


def test_limit_from_the_data() -> None:
    values = np.concatenate((np.linspace(-0.1, 0.1, 98), [5.0, np.nan]))
    assert colour_limit(values) == 0.1
    assert colour_limit(values, level=0.2) == 0.4
    assert colour_limit(values, 0.33) == 0.33
    assert colour_limit(np.array([])) == 0.01
    assert colour_limit(np.array([np.nan]), level=float("nan")) == 0.01


@pytest.mark.parametrize(("value", "expected"), [(0.101, 0.15), (0.3, 0.3), (0.61, 0.8), (8.1, 10.0), (0.001, 0.001)])
def test_rounded_up(value: float, expected: float) -> None:
    assert rounded_up(value) == expected
