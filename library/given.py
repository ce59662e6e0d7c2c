"""What the library's functions take: points as an array, a laspy cloud, a file, or what one of them returned."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import TypeAlias

import geopandas as gpd
import laspy
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError
from shapely.geometry.base import BaseGeometry

from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.crs.working_frame import given_crs, working_frame
from ..engine.epochs.epoch import Epoch
from ..engine.ground.raw_survey import bareness_of, refuse_signs, taken_as_ground
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.plant_cover import ERROR, HEIGHT
from ..engine.pointcloud.reading import eight_bits, open_cloud
from ..engine.pointcloud.returns import Returns, last_returns
from ..engine.registration.result import RegistrationResult
from ..engine.vector.area import read_roi
from ..interface.dates import date_in_name
from ..interface.parameters import InputParameters

LOCAL = CRS.from_wkt(
    'ENGCRS["Local grid, metres",EDATUM["Unknown"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],'
    'LENGTHUNIT["metre",1]]'
)
"""The reference system of an array for which none is given."""


@dataclass(frozen=True)
class Survey:
    """Points of one survey in metres, with what is known of them.

    Attributes:
        points: coordinates, classes, colours and plants; ``points.xyz`` (n, 3) in ``points.crs``.
        returns: which of the points are last returns; None where that is not known.
        source: the laspy records that the points are of, and ``rows`` (n,) which of them.
        registration: what moved the points onto another survey; None where nothing did.
        bare: whether the points are known to be ground.
    """

    points: PointCloud
    returns: Returns | None = None
    source: laspy.LasData | None = None
    rows: NDArray[np.int64] | None = None
    registration: RegistrationResult | None = None
    bare: bool = False

    def __len__(self) -> int:
        return len(self.points)

    def chosen(self, rows: NDArray[np.signedinteger] | NDArray[np.bool_]) -> Survey:
        """Some of the points, by number or mask."""
        kept = {f.name: getattr(self.points, f.name) for f in fields(self.points)}
        kept |= {name: array[rows] for name, array in kept.items() if isinstance(array, np.ndarray)}
        own = None if self.rows is None else self.rows[rows]
        returns = None if self.returns is None else replace(self.returns, last=self.returns.last[rows])
        return replace(self, points=PointCloud(**kept), returns=returns, rows=own)

    def epoch(self, day: date | None) -> Epoch:
        """The survey with its day, which its file's name may give."""
        return Epoch(self.points.path, day or date_in_name(self.points.path))


class Surveyed:
    """Base of what is a survey itself, among other things: ``survey`` gives it."""

    survey: Survey


Cloud: TypeAlias = NDArray[np.floating] | laspy.LasData | str | Path | Surveyed
Area: TypeAlias = BaseGeometry | gpd.GeoDataFrame | str | Path


def survey_of(given: Cloud, name: str, crs: str | CRS | None, progress: Progress) -> Survey:
    """A survey from whatever a caller gave.

    Args:
        given: (n, 3) coordinates; records that laspy read; a LAS, LAZ or COPC file; or the result of another function.
        name: of the survey, for messages.
        crs: the reference system, where the points do not say theirs or say a wrong one.

    Raises:
        InputError: it is none of these, holds no points, or not three finite numbers a point.
    """
    if isinstance(given, Surveyed):
        return given.survey
    if isinstance(given, (str, Path)):
        header, _ = open_cloud(given, _inputs(crs), progress)
        return _of_records(laspy.read(header.path), Path(given), crs)
    if isinstance(given, laspy.LasData):
        return _of_records(given, Path(name), crs)
    try:
        xyz = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        xyz = np.empty(0)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError(
            f"The {name} survey is {_shape_of(given)}; give an array of x, y and z (n, 3), a laspy cloud or a file."
        )
    system = LOCAL if crs is None else working_frame(None, _inputs(crs), name)
    if isinstance(system, CRS):
        return Survey(PointCloud(_sound(xyz, name), system, Path(name)))
    return Survey(PointCloud(_sound(xyz * system.factors, name), system.crs, Path(name)))


def _of_records(las: laspy.LasData, path: Path, crs: str | CRS | None) -> Survey:
    try:
        declared = las.header.parse_crs()
    except CRSError:
        declared = None
    name = path.name
    if declared is None and crs is None:
        raise InputError(f"The survey {name} declares no coordinate reference system; give a projected one as crs.")
    frame = working_frame(declared, _inputs(crs), path)
    xyz = _sound(np.asarray(las.xyz, dtype=np.float64) * frame.factors, name)
    known = set(las.point_format.dimension_names)
    returns = last_returns(np.asarray(las.return_number), np.asarray(las.number_of_returns))
    plants = {n: np.asarray(las[n], dtype=np.float32) for n in (ERROR, HEIGHT) if n in known}
    coloured = {"red", "green", "blue"} <= known
    rgb = eight_bits(np.column_stack([las.red, las.green, las.blue])) if coloured else None
    points = PointCloud(
        xyz, frame.crs, path, rgb=rgb, intensity=np.asarray(las.intensity),
        classification=np.asarray(las.classification), notes=frame.notes,
        plant_error=plants.get(ERROR), plant_height=plants.get(HEIGHT),
    )  # fmt: skip
    return Survey(points, returns, las, np.arange(len(xyz)))


def ground_survey(given: Cloud, name: str, crs: str | CRS | None, ground: str, progress: Progress) -> Survey:
    """As ``survey_of``, of ground: what is a raw survey is refused.

    Args:
        ground: as of ``SurfaceParameters``.

    Raises:
        InputError: the points are no bare ground, or have none of class 2 where these are asked for.
    """
    survey = survey_of(given, name, crs, progress)
    points = survey.points
    mask = taken_as_ground(points.classification, ground, points.path)
    if mask is not None:
        return replace(survey.chosen(mask), bare=True)
    if ground == "auto" and not survey.bare:
        followed = np.zeros(len(survey), bool) if survey.returns is None else ~survey.returns.last
        refuse_signs(points.path, bareness_of(points.xyz, points.classification, followed))
    return survey


def area_of(given: Area | None, crs: CRS, name: str) -> BaseGeometry | None:
    """An area in the surveys' reference system.

    Raises:
        InputError: see ``read_roi``; it is no geometry, table of geometries or file.
    """
    if given is None or isinstance(given, BaseGeometry):
        return given
    if isinstance(given, gpd.GeoDataFrame):
        moved = given if given.crs is None or crs is LOCAL else given.to_crs(crs)
        return moved.union_all()
    if isinstance(given, (str, Path)):
        return read_roi(given, crs).geometry
    raise InputError(f"{name} is {_shape_of(given)}; give a shapely geometry, a GeoDataFrame or a vector file.")


def _inputs(crs: str | CRS | None) -> InputParameters:
    if crs is None:
        return InputParameters()
    return InputParameters(crs=crs.to_wkt() if isinstance(crs, CRS) else given_crs(crs).to_string())


def _sound(xyz: Float, name: str) -> Float:
    if not len(xyz):
        raise InputError(f"The {name} survey holds no points.")
    wrong = len(xyz) - int(np.count_nonzero(np.isfinite(xyz).all(axis=1)))
    if wrong:
        raise InputError(
            f"{wrong} of {len(xyz)} points of the {name} survey have no finite coordinates; leave them out."
        )
    return xyz


def _shape_of(given: object) -> str:
    shape = getattr(given, "shape", None)
    return f"an array of shape {shape}" if isinstance(shape, tuple) else f"of the type {type(given).__name__}"
