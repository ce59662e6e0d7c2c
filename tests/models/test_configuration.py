"""Settings of models: their way through JSON, what is refused, the numbers derived from them."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.configuration import PAPER, SMOKE, ModelConfiguration


@pytest.mark.parametrize("configuration", [PAPER, SMOKE, ModelConfiguration()], ids=lambda c: c.name)
def test_a_configuration_survives_json(configuration):
    assert ModelConfiguration.from_mapping(json.loads(configuration.to_json())) == configuration


def test_the_published_settings():
    assert (PAPER.voxel, PAPER.plane_iterations, PAPER.plane_distance) == (0.01, 64, 0.08)
    assert (PAPER.window, PAPER.step, PAPER.minimum_points, PAPER.block_points) == (20.0, 18.0, 4096, 131_072)
    assert PAPER.features == ("x", "y", "z")
    assert PAPER.xy_scale == PAPER.z_scale == PAPER.window / 2
    assert (PAPER.neighbours, PAPER.decimation, PAPER.stem, PAPER.dropout) == (16, 4, 8, 0.5)
    assert PAPER.sampling == "random"
    assert [2 * width for width in PAPER.widths] == [32, 128, 256, 512]
    assert PAPER.offset_scales() == (1.0, 1.0, 1.0, 1.0)


def test_the_radius_holds_the_neighbours_of_a_fully_covered_plane():
    configuration = ModelConfiguration(voxel=0.1, neighbours=16, decimation=4)
    for level, spacing in enumerate((0.1, 0.2, 0.4, 0.8)):
        assert math.pi * configuration.radius(level) ** 2 / spacing**2 == pytest.approx(16)
        assert configuration.offset_scales()[level] == pytest.approx(10.0 / configuration.radius(level))


def test_what_cannot_be_used_is_refused():
    with pytest.raises(InputError, match="features"):
        replace(SMOKE, features=("x", "y", "red"))
    with pytest.raises(InputError, match="voxel"):
        replace(SMOKE, voxel=0.0)
    with pytest.raises(InputError, match="left out"):
        replace(SMOKE, step=21.0)
    with pytest.raises(InputError, match="thinnings"):
        replace(SMOKE, thinnings=0)
    with pytest.raises(InputError, match="sampling"):
        replace(SMOKE, sampling="dense")
    values = json.loads(SMOKE.to_json())
    del values["voxel"]
    with pytest.raises(InputError, match="voxel"):
        ModelConfiguration.from_mapping(values)


def test_a_model_that_does_not_name_its_sampling_was_made_with_random_points():
    values = json.loads(SMOKE.to_json())
    del values["sampling"], values["thinnings"]
    assert ModelConfiguration.from_mapping(values) == replace(SMOKE, sampling="random")
