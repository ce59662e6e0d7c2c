"""Simulated scenes as blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from slopewatch.models.configuration import SMOKE
from slopewatch.simulation.hazard_scenes.scenes import build_scene
from slopewatch.simulation.hazard_scenes.sets import training_specs


def tiny_blocks_of(spec):
    from slopewatch.lab.making.scene_blocks import scene_blocks
    from slopewatch.models.training.recipes import Recipe
    from slopewatch.models.training.training import TrainingParameters

    tiny = replace(SMOKE, widths=(4, 8), voxel=0.5, trends=((4.0, 4.0),))
    return spec.seed, scene_blocks(Recipe(tiny, TrainingParameters(), step=tiny.step), build_scene(spec))


def test_several_processes_make_the_same_blocks_in_the_same_order(torch):
    from slopewatch.lab.making.scene_blocks import in_order

    # The first scene is the largest, so that it is the last to be made where two are made at once.
    areas = (900.0, 150.0, 150.0, 150.0)
    specs = [
        replace(spec, area=area, density=25.0) for spec, area in zip(training_specs("realistic", len(areas)), areas)
    ]
    one, two = (list(in_order(tiny_blocks_of, specs, processes)) for processes in (1, 2))
    assert [seed for seed, _ in one] == [seed for seed, _ in two] == [spec.seed for spec in specs]
    for (_, expected), (_, found) in zip(one, two, strict=True):
        assert expected
        for a, b in zip(expected, found, strict=True):
            for name in ("coordinates", "residuals", "labels"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
            np.testing.assert_array_equal(a.levels[0].neighbours, b.levels[0].neighbours)
