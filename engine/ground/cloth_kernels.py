"""The two loops of the cloth simulation: one step of the cloth, and pinning what hangs beside a steep face.

Heights are those of the library: upside down, so that the cloth falls onto the ground from below. A cloth is a flat
array of rows with a frame of ``FRAME`` particles that are ``ABSENT`` around it, ``row`` particles a row. The order in
which particles pull each other is the library's, because it decides the last digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..core.compiled import Kernel, compiled

FIXED, MOVABLE, ABSENT = 0, 1, 2
FRAME = 2
"""Particles: a constraint reaches so far."""
_KEPT_SPEED = 1.0 - 0.01
_SETTLED_M = 0.005
"""Height; a step in which no particle moves farther is the last one."""
_SMALLEST_PART = 50
"""Particles that hang together; of fewer none is pinned."""
_STEP_M, _REACH_M = 0.3, 9999.0
"""Between neighbours on the ground, and between cloth and ground: a particle beyond either is not pinned."""
Byte = NDArray[np.uint8]
Number = NDArray[np.int32]


def neighbours(row: int) -> Index:
    """(16,) distances in the flat array to what a particle is tied to, in the library's order."""
    near = np.array([-row - 1, -1, row - 1, -row, -row + 1, 1, row, row + 1])
    return np.concatenate([near, 2 * near])


def _settle_by_numpy(
    cloth: Float, before: Float, ground: Float, state: Byte, row: int, pull: Float, weight: float, steps: int
) -> int:
    tied = neighbours(row)
    columns, rows = row - 2 * FRAME, len(cloth) // row - 2 * FRAME
    for step in range(steps):
        free, fixed = state == MOVABLE, state == FIXED
        fallen = (cloth + (cloth - before) * _KEPT_SPEED) + weight
        np.copyto(before, cloth, where=free)
        np.copyto(cloth, fallen, where=free)
        # a particle's pull depends on those up to four columns and rows before it: these come five steps apart
        for wave in range(columns + 5 * (rows - 1)):
            first = max(0, -((columns - 1 - wave) // 5))
            last = min(rows - 1, wave // 5)
            start = (first + FRAME) * row + FRAME + wave - 5 * first
            here = slice(start, start + (last - first) * (row - 5) + 1, row - 5)
            moving, height = free[here], cloth[here].copy()
            for far in tied:
                there = slice(here.start + far, here.stop + far, here.step)
                also = free[there]
                gap = cloth[there] - height
                height += gap * np.where(moving, np.where(also, pull[1], np.where(fixed[there], pull[0], 0.0)), 0.0)
                cloth[there] -= gap * np.where(also, np.where(moving, pull[1], pull[0]), 0.0)
            cloth[here] = height
        moved = np.abs(before - cloth)[free].max(initial=0.0)
        landed = free & (cloth < ground)
        cloth[landed] += ground[landed] - cloth[landed]
        state[landed] = FIXED
        if moved != 0 and moved < _SETTLED_M:
            return step + 1
    return steps


@compiled(_settle_by_numpy)
def settle(
    cloth: Float, before: Float, ground: Float, state: Byte, row: int, pull: Float, weight: float, steps: int
) -> int:
    """Let the cloth fall until it rests, for ``steps`` steps at most; how many there were.

    Args:
        cloth, before: (n,) m, heights now and a step ago; both are changed. ground: (n,) m, where it lands.
        state: (n,) FIXED, MOVABLE or ABSENT; changed.
        pull: shares of a height difference by which a particle is moved if the other is fixed, and if it is not.
        weight: m, by which a particle falls further in each step.
    """
    tied = np.array([-row - 1, -1, row - 1, -row, -row + 1, 1, row, row + 1])
    tied = np.concatenate((tied, 2 * tied))
    rows = len(cloth) // row
    single, double = pull[0], pull[1]
    for step in range(steps):
        for i in range(len(cloth)):
            if state[i] == MOVABLE:
                now = cloth[i]
                cloth[i] = (now + (now - before[i]) * _KEPT_SPEED) + weight
                before[i] = now
        for y in range(FRAME, rows - FRAME):
            for i in range(y * row + FRAME, y * row + row - FRAME):
                height = cloth[i]
                if state[i] == MOVABLE:
                    for far in tied:
                        other = state[i + far]
                        gap = cloth[i + far] - height
                        if other == MOVABLE:
                            height += gap * double
                            cloth[i + far] -= gap * double
                        elif other == FIXED:
                            height += gap * single
                    cloth[i] = height
                else:
                    for far in tied:
                        if state[i + far] == MOVABLE:
                            cloth[i + far] -= (cloth[i + far] - height) * single
        moved = 0.0
        for i in range(len(cloth)):
            if state[i] == MOVABLE:
                moved = max(moved, abs(before[i] - cloth[i]))
                if cloth[i] < ground[i]:
                    cloth[i] += ground[i] - cloth[i]
                    state[i] = FIXED
        if moved != 0 and moved < _SETTLED_M:
            return step + 1
    return steps


def _gathered(state: Byte, seen: Byte, place: Number, part: Number, links: Number, row: int, begin: int) -> int:
    """Particles that hang together with ``begin``, into ``part``, with the numbers of their neighbours in ``links``."""
    part[0], count, done = begin, 1, 0
    seen[begin] = 1
    while done < count:
        for side in range(4):
            near = part[done] + (-1, 1, -row, row)[side]
            links[done, side] = -1
            if state[near] != MOVABLE:
                continue
            if not seen[near]:
                seen[near], place[near], part[count] = 1, count, near
                count += 1
            links[done, side] = place[near]
        done += 1
    return count


def _pin(cloth: Float, ground: Float, state: Byte, part: Number, links: Number, row: int, count: int) -> None:
    """Pin those of a part beside fixed ones of about their ground's height, then their neighbours, and so on."""
    queue, queued, length = np.empty(count, np.int32), np.zeros(count, np.uint8), 0
    for number in range(count):
        i = part[number]
        for side in range(4):
            near = i + (-1, 1, -row, row)[side]
            level = state[near] == FIXED and abs(ground[i] - ground[near]) < _STEP_M
            if level and cloth[i] - ground[i] < _REACH_M:
                cloth[i] += ground[i] - cloth[i]
                state[i] = FIXED
                queue[length], queued[number] = number, 1
                length += 1
                break
    done = 0
    while done < length:
        number = queue[done]
        done += 1
        i = part[number]
        for side in range(4):
            other = links[number, side]
            if other < 0:
                continue
            near = part[other]
            if abs(ground[i] - ground[near]) < _STEP_M and abs(cloth[near] - ground[near]) < _REACH_M:
                if state[near] == MOVABLE:
                    cloth[near] += ground[near] - cloth[near]
                    state[near] = FIXED
                if not queued[other]:
                    queue[length], queued[other] = other, 1
                    length += 1


def _pin_hanging(cloth: Float, ground: Float, state: Byte, seen: Byte, row: int) -> None:
    """Pin particles that hang beside ground of about the same height (the library's post-processing).

    Args:
        seen: (n,) particles from which no search begins are 1; changed.
    """
    rows = len(cloth) // row
    place, part = np.zeros(len(cloth), np.int32), np.empty(len(cloth), np.int32)
    links = np.empty((len(cloth), 4), np.int32)
    for x in range(FRAME, row - FRAME):
        for y in range(FRAME, rows - FRAME):
            i = y * row + x
            if state[i] == MOVABLE and not seen[i]:
                count = _gathered(state, seen, place, part, links, row, i)
                if count > _SMALLEST_PART:
                    _pin(cloth, ground, state, part, links, row, count)


pin_hanging: Kernel[[Float, Float, Byte, Byte, int], None] = compiled(_pin_hanging, _gathered, _pin)(_pin_hanging)
