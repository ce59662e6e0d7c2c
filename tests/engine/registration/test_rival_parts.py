"""Which of two parts stayed; places that contradict a part; walls that keep level ground from sliding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.registration.observability import Information
from slopewatch.engine.registration.part_information import contradicting
from slopewatch.engine.registration.patch_agreement import FINAL_POINTS
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.rival_parts import Evidence, Verdict, difference, refusal, standing, verdict
from slopewatch.engine.registration.stable_patches import StablePart, _Task
from slopewatch.engine.registration.surface import Surface
from slopewatch.engine.registration.surface_patches import Equations, Patches, cut, equations
from slopewatch.interface.parameters import RegistrationParameters

OPEN = Information(np.ones(6), np.eye(6), np.ones(6, dtype=bool), np.eye(6) * 1e-6)
SIDE = 20  # patches a side, 1 m each


def patches() -> Patches:
    x, y = (v.ravel() + 0.5 for v in np.mgrid[:SIDE, :SIDE])
    centre = np.column_stack([x, y, np.zeros(x.size)])
    normal = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    number = np.arange(x.size, dtype=np.int64)
    return Patches(number, number, centre, normal, np.ones(x.size), 1.0)


def part(share: float, shift: float, where: np.ndarray, other: StablePart | None = None) -> StablePart:
    return StablePart(Pose(np.eye(3), np.array([shift, 0.0, 0.0])), patches(), where, share, OPEN, other)


PLACES = patches().centre[:, :2]
RING = np.abs(PLACES - SIDE / 2).max(axis=1) > 7
BLOCK = np.abs(PLACES - SIDE / 2).max(axis=1) < 5
STRIP = PLACES[:, 0] < 2
WEST, EAST = PLACES[:, 0] < 8, PLACES[:, 0] > 12


@pytest.mark.parametrize(
    ("largest", "second", "where", "known"),
    [
        (0.60, 0.20, (WEST, EAST), True),
        (0.45, 0.36, (WEST, EAST), False),
        (0.40, 0.26, (WEST, EAST), False),  # no majority, two compact halves
        (0.40, 0.26, (RING, BLOCK), False),  # the same around a block: no majority either
        (0.55, 0.36, (RING, BLOCK), True),  # a majority around a block
        (0.55, 0.36, (WEST, EAST), False),
        (0.60, 0.31, (WEST, EAST), True),  # a third sank beside the rest
        (0.60, 0.34, (WEST, EAST), False),
        (0.60, 0.15, (BLOCK, RING), False),  # what lies around may have stayed
        (0.60, 0.11, (BLOCK, RING), True),
        (0.60, 0.00, (BLOCK, PLACES[:, 0] < 0), True),  # nothing else agrees on anything
        (0.60, 0.15, (BLOCK, STRIP), True),  # a strip beside lies around nothing
        (0.45, 0.22, (WEST, EAST), True),
        (0.30, 0.15, (WEST, EAST), False),  # the larger may be a block that moved, where little stayed
        (0.22, 0.08, (WEST, EAST), True),
        (0.16, 0.08, (WEST, EAST), False),  # less than twice what agrees by chance
        (0.13, 0.02, (WEST, EAST), False),  # as much agrees by chance
    ],
)
def test_a_part_is_known_by_its_size_and_by_what_lies_around_it(largest, second, where, known):
    found = standing(part(largest, 0.1, where[0], part(second, 0.3, where[1])), 5.0)
    assert found.known is known
    assert not found.by_position
    assert found.contested is (not known and second > 0.1)


@pytest.mark.parametrize(
    ("wanted", "seen"),
    [
        (Verdict.NEITHER, Evidence(0.19, 0.02)),
        (Verdict.PART, Evidence(0.21, 0.09, "around", rose=True)),  # as much agrees by chance
        (Verdict.OTHER_BY_POSITION, Evidence(0.48, 0.42, offset=0.8)),
        (Verdict.UNDECIDED, Evidence(0.60, 0.30, offset=0.8)),
        (Verdict.PART, Evidence(0.60, 0.30, offset=0.8, other_offset=0.3)),
        (Verdict.PART_BY_POSITION, Evidence(0.70, 0.20, rose=True, other_offset=0.6)),
        (Verdict.UNDECIDED, Evidence(0.70, 0.20, rose=True)),
        (Verdict.PART, Evidence(0.82, 0.12, rose=True)),  # rather a fill than what stayed
        (Verdict.UNDECIDED, Evidence(0.60, 0.30, "within", rose=True)),
        (Verdict.PART, Evidence(0.80, 0.12)),
        (Verdict.PART, Evidence(0.60, 0.11, "around")),
        (Verdict.UNDECIDED, Evidence(0.60, 0.13, "around")),
        (Verdict.PART, Evidence(0.39, 0.15)),
        (Verdict.UNDECIDED, Evidence(0.39, 0.16)),
        (Verdict.PART, Evidence(0.60, 0.32)),
        (Verdict.UNDECIDED, Evidence(0.60, 0.34)),
        (Verdict.PART, Evidence(0.55, 0.38, "within")),
        (Verdict.UNDECIDED, Evidence(0.55, 0.39, "within")),
        (Verdict.UNDECIDED, Evidence(0.45, 0.30, "within")),
        (Verdict.PART_BY_POSITION, Evidence(0.48, 0.42, other_offset=0.8)),
        (Verdict.UNDECIDED, Evidence(0.48, 0.42)),
    ],
)
def test_each_row_of_the_table(wanted, seen):
    assert verdict(seen) is wanted


def raised(share: float, height: float, where: np.ndarray, other: StablePart | None = None) -> StablePart:
    """A part that its pose lifts by a height."""
    return replace(part(share, 0.0, where, other), pose=Pose(np.eye(3), np.array([0.0, 0.0, height])))


@pytest.mark.parametrize(("height", "rose"), [(0.2, True), (-0.2, False), (0.002, False)])
def test_a_block_that_sank_is_not_taken_for_the_ground_that_then_rose(height, rose):
    """The larger part sank by ``height``. To lay it on the reference lifts what stayed, too."""
    found = standing(raised(0.70, height, WEST, part(0.20, 0.0, EAST)), 5.0)
    assert found.rose is rose
    assert found.contested is rose
    if rose:
        assert "20% then rose against it" in refusal(found)
    unsure = replace(OPEN, covariance=np.eye(6) * 0.2**2)
    other = replace(part(0.20, 0.0, EAST), information=unsure)
    assert not standing(raised(0.70, height, WEST, other), 5.0).rose


def test_two_like_parts_are_told_apart_by_where_they_were_surveyed():
    """One moved by 0.8 m; no survey is off by that much and leaves half of the slope where it was."""
    for moved, still in ((0.48, 0.42), (0.42, 0.48)):
        sides = [part(moved, 0.8, WEST), part(still, 0.05, EAST)]
        first, second = sorted(sides, key=lambda one: -one.share)
        found = standing(StablePart(first.pose, first.patches, first.agrees, first.share, OPEN, second), 5.0)
        assert found.known
        assert found.by_position
        assert found.part.pose.translation[0] == pytest.approx(0.05)
        assert found.part.other is not None
        assert found.other_offset == pytest.approx(0.8)


def test_two_like_parts_near_where_they_were_surveyed_are_refused_with_both_named():
    found = standing(part(0.45, 0.05, WEST, part(0.40, 0.20, EAST)), 5.0)
    assert found.contested
    sentence = refusal(found)
    assert all(word in sentence for word in ("45%", "40%", "0.05 m", "0.20 m", "0.15 m apart", "--stable", "--accept"))
    assert difference(found, 3.0) == pytest.approx([0, 0, 0, 0.15, 0, 0])


def test_a_large_part_far_off_is_doubted_where_another_lies_as_surveyed():
    """As where most of a slope slid by 0.8 m as one."""
    for rival in (0.30, 0.12):
        assert standing(part(0.60, 0.8, WEST, part(rival, 0.05, EAST)), 5.0).contested
    assert standing(part(0.60, 0.8, WEST, part(0.30, 0.60, EAST)), 5.0).known  # a datum that is off takes all along


def system(asked: np.ndarray) -> Equations:
    """Patches with relief in every direction, each of which asks for a motion (k, 6)."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(len(asked), 12, 6)) / 3
    matrix = np.einsum("kpi,kpj->kij", jacobian, jacobian) / 12
    count = np.full(len(asked), 60.0)
    noise = rng.normal(0, 0.0004, asked.shape)
    vector = -np.einsum("kij,kj->ki", matrix, asked + noise)
    return Equations(matrix, vector, np.full(len(asked), 9e-6), asked, count, 0.0, Pose.identity())


def test_a_place_that_asks_for_another_motion_is_left_out_of_a_part():
    inside = np.abs(PLACES - [5.0, 5.0]).max(axis=1) < 2.5
    asked = np.zeros((SIDE**2, 6))
    everything = np.ones(SIDE**2, dtype=bool)
    assert contradicting(system(asked), patches(), everything, 1.0).mean() < 0.02
    asked[inside, 3] = 0.004
    odd = contradicting(system(asked), patches(), everything, 1.0)
    assert odd[inside].mean() > 0.7
    assert odd[~inside].mean() < 0.1


def yard(seed: int, shifts: tuple[float, ...]) -> np.ndarray:
    """Level ground with walls along y, of which each is shifted along x, and two along x."""
    rng = np.random.default_rng(seed)

    def wall(along: int, at: float, start: float) -> np.ndarray:
        points = np.empty((600, 3))
        points[:, along], points[:, 1 - along] = rng.uniform(start, start + 4, 600), at
        points[:, 2] = rng.uniform(0.05, 1.5, 600)
        return points

    ground = np.column_stack([rng.uniform(-8, 8, (25_000, 2)), np.zeros(25_000)])
    walls = [wall(1, -6 + 4 * n + shift, -5 + 2 * (n % 2)) for n, shift in enumerate(shifts)]
    found = np.concatenate([ground, *walls, wall(0, 6, -6), wall(0, 6.5, 1)])
    return np.asarray(found + rng.normal(0, 0.003, found.shape))


def upright(shifts: tuple[float, ...], start: float) -> tuple[Pose, Information, Information]:
    """The pose that walls set right which was settled where the shifted ones fit, what it fixes, and what before."""
    matcher = Matcher(Surface(yard(1, (0.0,) * len(shifts)), 0.1), Surface(yard(2, shifts), 0.1))
    found = cut(matcher.moving, 0.01)
    everywhere = np.ones(len(found), dtype=bool)
    task = _Task(matcher, found, 0.5)
    settled = task.settled(everywhere, Pose(np.eye(3), np.array([start, 0, 0])), FINAL_POINTS)
    assert settled.pose.translation[0] == pytest.approx(start, abs=0.02)
    best = task.upright(settled)
    return best.pose, best.information, settled.information


def test_most_walls_tell_how_level_ground_lies():
    pose, known, _ = upright((0.0, 0.0, 0.12), -0.12)
    assert pose.translation[0] == pytest.approx(0.0, abs=0.003)
    assert known.observable.all()


def test_walls_that_contradict_one_another_leave_the_direction_open():
    _, known, before = upright((0.0, 0.12, 0.0, 0.12), -0.12)
    sideways = np.array([0.0, 0, 0, 1, 0, 0])
    assert before.observable.all()
    free = known.directions[:, ~known.observable]
    assert np.sum((free.T @ sideways) ** 2) > 0.5
    assert sideways @ known.covariance @ sideways > 0.1**2


def test_equations_tell_a_shift_of_both_surfaces():
    surfaces = Surface(yard(1, (0.0, 0.0)), 0.1), Surface(yard(2, (0.0, 0.0)) + [0, 0, 0.02], 0.1)
    found = cut(surfaces[1], 0.01)
    asked = equations(Matcher(*surfaces), found, Pose.identity(), 0.3).own
    level = np.abs(found.normal[:, 2]) > 0.99
    assert np.median(asked[level, 5]) == pytest.approx(-0.02, abs=0.002)


def test_a_plane_of_which_a_third_sank_is_registered_by_the_rest():
    """Noise alone makes places of a plane contradict one another; they still count towards the part that stayed."""

    def plane(seed: int, lowered: float) -> np.ndarray:
        rng = np.random.default_rng(seed)
        u, v = rng.uniform(0, 12, (2, 20_000))
        return np.column_stack([u, v, 50 + 0.5 * v + rng.normal(0, 0.01, u.size) - np.where(u < 4, lowered, 0.0)])

    found = register(plane(11, 0.0), plane(21, 0.2), RegistrationParameters())
    stayed = np.array([[8.0, 6.0, 53.0]])
    assert abs((found.transform.apply(stayed) - stayed)[0, 2]) < 0.005
