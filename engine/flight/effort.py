"""How long a flight takes, and how many batteries it needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...interface.parameters import FlightParameters
from ..core.errors import InputError
from .lines import Line


@dataclass(frozen=True)
class Effort:
    """``seconds`` over lines and turns, metres over lines alone, and the ``battery`` of each line, from 1 on."""

    seconds: float
    length: float
    battery: tuple[int, ...]

    @property
    def batteries(self) -> int:
        return self.battery[-1]


def effort_of(lines: list[Line], parameters: FlightParameters) -> Effort:
    """Time over lines and turns; a battery is changed between lines only.

    Raises:
        InputError: one line takes longer than a battery lasts.
    """
    lasts = 60.0 * parameters.battery_time
    total, spent, number, batteries = 0.0, 0.0, 1, []
    for line, before in zip(lines, [None, *lines[:-1]], strict=True):
        seconds = line.length / parameters.flying_speed
        turn = 0.0
        if before is not None:
            turn = float(np.linalg.norm(line.xyz[0] - before.xyz[-1])) / parameters.flying_speed + parameters.turn_time
        if seconds > lasts:
            raise InputError(
                f"Line {line.number} takes {seconds / 60:.1f} min, longer than a battery of "
                f"{parameters.battery_time:g} min; raise --battery-time or --flying-speed, or divide the region."
            )
        if spent + turn + seconds > lasts:
            number, spent = number + 1, seconds
        else:
            spent += turn + seconds
        total += turn + seconds
        batteries.append(number)
    return Effort(total, math.fsum(line.length for line in lines), tuple(batteries))
