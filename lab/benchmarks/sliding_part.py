"""Registration where a part of the slope slid along itself: how far it is pulled along, and what error it states.

A slide keeps the surface's distance along its normal within the noise, so that weights by distance do not leave it out.
Simulated: extracted ground of two raw surveys under 70 % vegetation; of the later one an ellipse is moved down the dip,
or the simulation moves the ground itself. Ellipses that sank must not be said to have slid. Real: random halves of two
clouds, laid on a known offset and the same slides; halves share one scan, so that this is what the relief allows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...engine.core.arrays import Bool, Float
from ...engine.displacement.facets import Frame, find_facets
from ...engine.displacement.registered import Registered
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.ground.filtering import known_ground
from ...engine.pointcloud.plant_cover import PlantCover
from ...engine.pointcloud.reading import read_cloud
from ...engine.registration.register import register
from ...engine.registration.result import RegistrationResult
from ...interface.parameters import InputParameters, RegistrationParameters, SurveyParameters
from ...simulation.surveys.survey import SimulatedPair, simulate_pair
from .chain import Ground, ground_of
from .real_data import DATA, dense_cloud, split
from .table import Row, say

SEEDS, REAL_SEEDS, SCANNED_SEEDS = (1, 2, 3, 4, 5, 6), (1, 2, 3, 4), (1, 2)
SHARES = (0.05, 0.1, 0.2, 0.4)
AMOUNTS_M = (0.1, 0.2, 0.4)
SUNK = ((0.1, 0.04), (0.1, 0.12), (0.1, 0.3), (0.3, 0.04), (0.3, 0.3))
KINDS = ("translation", "creep", "slump")
AIRBORNE = DATA / "terrain" / "santa_cruz_gullies.laz"
AIRBORNE_NAME, DENSE_NAME = "airborne gullies (11 points/m²) in halves", "dense cloud (392 points/m²) in halves"
_AIRBORNE_SIDE_M = 100.0
_OFFSET_M, _TURN = 0.1, 2e-4
_LONG, _SOFT = 1.5, 0.75  # length of an ellipse by its width; where its soft edge begins
_NEAR_STD = 2.0


@dataclass(frozen=True)
class Case:
    """Ground of two surveys; ``truth`` takes the later one to the earlier, ``stable`` (m,) are its points that rest."""

    first: Ground
    second: Ground
    stable: Bool
    truth: RigidTransform
    share: float = 0.0
    amount: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """Errors of a registration on what rests, metres: of its mean along dip and strike (2,) and the standard errors
    stated of it (2,), and the same along the normal; ``slid`` is the share of the surface that is said to have slid.
    """

    share: float
    amount: float
    error: Float
    stated: Float
    normal: float
    normal_stated: float
    slid: float


def still_simulated(seed: int) -> Case:
    """Ground of two raw surveys in one frame, of which nothing has moved."""
    pair = simulate_pair(_survey(seed, "none", 0.0), changes=())
    return _case_of(pair)


def scanned(seed: int, kind: str, amount: float) -> Case:
    """A pair whose ground the simulation has moved before it was scanned."""
    return _case_of(simulate_pair(_survey(seed, kind, amount)))


def _survey(seed: int, kind: str, amount: float) -> SurveyParameters:
    return SurveyParameters(
        seed=seed, points=480_000, length=40.0, height=18.0, offset=_OFFSET_M, motion=kind, motion_amount=amount
    )


def _case_of(pair: SimulatedPair) -> Case:
    first, second = (ground_of(cloud, pair) for cloud in (pair.first, pair.second))
    way = np.nan_to_num(pair.true_motion(pair.transform.apply(second.xyz)), nan=1.0)
    stable: Bool = np.asarray((np.abs(way) <= 1e-6).all(axis=1))
    return Case(first, second, stable, pair.transform, float(1 - stable.mean()), pair.parameters.motion_amount)


def still_real(cloud: Float, seed: int, *, extract: bool) -> Case:
    """Two random halves of a cloud, the second with a known offset."""
    halves = split(cloud, seed)
    first, second = (half[known_ground(half).mask] for half in halves) if extract else halves
    rng = np.random.default_rng([seed, 29])
    direction, axis = rng.normal(size=(2, 3))
    truth = RigidTransform(
        Rotation.from_rotvec(_TURN * axis / np.linalg.norm(axis)).as_matrix(),
        _OFFSET_M * direction / np.linalg.norm(direction),
        first.mean(axis=0),
    )
    return Case(Ground(first), Ground(truth.inverse().apply(second)), np.ones(len(second), dtype=bool), truth)


def slid(case: Case, share: float, amount: float, seed: int) -> Case:
    """``case`` with an ellipse that holds a ``share`` of the later points moved down the dip by ``amount`` metres."""
    return _moved(case, share, amount, seed, find_facets(case.first.xyz).frames[0].axes[0])


def sunk(case: Case, share: float, amount: float, seed: int) -> Case:
    """The same, but straight down."""
    return _moved(case, share, amount, seed, np.array([0.0, 0.0, -1.0]))


def _moved(case: Case, share: float, amount: float, seed: int, way: Float) -> Case:
    """Args: way: (3,) unit vector."""
    frame = find_facets(case.first.xyz).frames[0]
    at = case.truth.apply(case.second.xyz)
    flat = frame.to_plane(at)[:, :2]
    rng = np.random.default_rng([seed, round(1000 * share)])
    middle = np.quantile(flat, rng.uniform(0.3, 0.7, 2), axis=0).diagonal()
    away = np.hypot((flat[:, 0] - middle[0]) / _LONG, flat[:, 1] - middle[1])
    radius = away / np.quantile(away, share)
    rise = np.clip((1 - radius) / (1 - _SOFT), 0.0, 1.0)
    moved = at + (amount * rise * rise * (3 - 2 * rise))[:, None] * way
    second = Ground(case.truth.inverse().apply(moved), case.second.plants)
    return Case(case.first, second, radius > 1.0, case.truth, share, amount)


Registering = Callable[[Float, Float, tuple[PlantCover | None, PlantCover | None]], RegistrationResult]


def _default(first: Float, second: Float, plants: tuple[PlantCover | None, PlantCover | None]) -> RegistrationResult:
    return register(first, second, RegistrationParameters(), plants=plants)


def judge(case: Case, registering: Registering = _default) -> Outcome:
    """Register a case and compare the motion with the truth on what rests."""
    found = registering(case.first.xyz, case.second.xyz, (case.first.plants, case.second.plants))
    frame: Frame = find_facets(case.first.xyz).frames[0]
    rests = case.second.xyz[case.stable]
    middle = case.truth.apply(rests).mean(axis=0)
    error = frame.to_plane(found.transform.apply(rests).mean(axis=0)) - frame.to_plane(middle)
    assert found.covariance is not None
    known = Registered(found.covariance, np.asarray(found.transform.centre), known=True)
    stated = np.sqrt(np.diag(frame.axes @ known.at(middle[None])[0] @ frame.axes.T))
    return Outcome(case.share, case.amount, error[:2], stated[:2], float(error[2]), float(stated[2]), found.slid)


def rows() -> list[Row]:
    """The figures with their targets."""
    found: list[Row] = []
    for name, bases in _bases():
        still, moving, sank = [], [], []
        for seed, base in bases:
            still.append(judge(base))
            for number, share in enumerate(SHARES):
                moving.append(judge(slid(base, share, AMOUNTS_M[(seed + number) % len(AMOUNTS_M)], seed)))
            sank += [judge(sunk(base, share, amount, seed)) for share, amount in SUNK]
            say(f"{name}, seed {seed}")
        found += [*_rows(f"{name}, still", still), *_rows(f"{name}, 5 to 40 % slid by 10 to 40 cm", moving)]
        wrong = sum(one.slid > 0 for one in (*still, *sank))
        about = f"{name}, still or 10 and 30 % sunk by 4 to 30 cm ({len(still) + len(sank)}): said to have slid"
        found.append(Row(about, f"{wrong}", "0", "", wrong == 0))
    made = [judge(scanned(seed, kind, amount)) for seed in SCANNED_SEEDS for kind in KINDS for amount in AMOUNTS_M]
    return [*found, *_rows("moved before it was scanned: translation, creep, slump of 10 to 40 cm", made)]


def _bases() -> Iterator[tuple[str, list[tuple[int, Case]]]]:
    cloud = dense_cloud()
    if cloud is not None:
        yield DENSE_NAME, [(seed, still_real(cloud, seed, extract=True)) for seed in REAL_SEEDS]
    airborne = airborne_cloud()
    if airborne is not None:
        yield AIRBORNE_NAME, [(seed, still_real(airborne, seed, extract=False)) for seed in REAL_SEEDS]
    yield "simulated, extracted ground", [(seed, still_simulated(seed)) for seed in SEEDS]


def airborne_cloud(path: Path = AIRBORNE) -> Float | None:
    """Ground points (n, 3) of a square in the middle of gullied ground, metres; None where it is missing."""
    if not path.exists():
        return None
    xyz = read_cloud(path, InputParameters()).xyz
    away = np.abs(xyz[:, :2] - np.median(xyz[:, :2], axis=0)).max(axis=1)
    return xyz[away < _AIRBORNE_SIDE_M / 2]


def _rows(name: str, outcomes: Sequence[Outcome]) -> Iterator[Row]:
    error, stated = (np.array([getattr(one, key) for one in outcomes]) for key in ("error", "stated"))
    within = 100 * float((np.abs(error) < _NEAR_STD * stated).mean())
    rms, worst = 1000 * np.sqrt((error**2).mean(axis=0)), 1000 * np.abs(error).max()
    typical = 1000 * np.median(stated, axis=0)
    yield Row(
        f"{name} ({len(outcomes)}): rms error along dip / strike",
        f"{rms[0]:.1f} / {rms[1]:.1f} mm", "",
        f"worst {worst:.1f} mm; stated, median {typical[0]:.1f} / {typical[1]:.1f} mm",
    )  # fmt: skip
    yield Row("the same: within two stated standard errors", f"{within:.0f} %", "≥ 95 %", "", within >= 95)
