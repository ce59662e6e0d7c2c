"""The limit of memory: what is given, half of the machine's by default, shared by surveys worked on at once."""

from __future__ import annotations

from dataclasses import asdict

import pytest
from slopewatch.engine.ground.tiles import memory as module
from slopewatch.engine.ground.tiles.memory import fits_in_one_piece, memory_limit, shared_memory
from slopewatch.interface.parameters import GroundParameters
from slopewatch.workflows.series_preparation import ground_key


def test_the_limit_is_as_given_or_half_of_the_machine(monkeypatch):
    monkeypatch.setattr(module, "machine_memory", lambda: 24_000_000_000)
    assert memory_limit(GroundParameters()) == 12e9
    assert memory_limit(GroundParameters(ground_memory=3.0)) == 3e9
    # 100 M points of one slope do not fit into half of such a machine, 40 M do
    assert not fits_in_one_piece(100_000_000, 4_000_000, GroundParameters())
    assert fits_in_one_piece(40_000_000, 4_000_000, GroundParameters())


def test_surveys_at_once_share_the_limit(monkeypatch):
    monkeypatch.setattr(module, "machine_memory", lambda: 24_000_000_000)
    assert shared_memory(GroundParameters(), 2).ground_memory == pytest.approx(6.0)
    assert shared_memory(GroundParameters(ground_memory=3.0), 2).ground_memory == pytest.approx(1.5)
    assert shared_memory(GroundParameters(ground_memory=0.4), 2).ground_memory == module.MIN_MEMORY_GB


def test_a_series_keeps_its_ground_whatever_the_limit():
    def key(**parameters):
        return ground_key("cloud", "region", {}, asdict(GroundParameters(**parameters)), "2.9.0")

    assert key(ground_memory=1.0) == key()
    assert key(cloth_reach=0.4) != key()
