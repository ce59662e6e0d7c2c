"""The reviews in the earlier results of an output folder, carried over into the new ones."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd
import pyogrio
import shapely
from pyproj.exceptions import CRSError

from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.progress import Progress
from ..core.staged_outputs import Stage
from ..vector.geopackage import Layer, write_layers
from ..vector.measured_columns import guarded_columns
from ..vector.review_fields import REVIEW_FIELDS, own_columns
from .review_carrying import carry_reviews

NOT_CARRIED = "reviews_not_carried.gpkg"
"""What no zone continues, with its polygons; a later run tries again."""
_LAYER = "zones"
_IDENTIFYING = ("zone_id", "kind", "epoch_from", "epoch_to", "run_id")
_ADDED = ("from_file", "why_not_carried")


@dataclass
class EarlierReviews:
    """Reads what people entered in ``folder`` and carries it over; made before a run's work, used at its end.

    Args:
        folder: of the outputs.
        files: GeoPackages with zones that the run will replace.
        not_carried: name of the file for what no zone continues.

    Raises:
        InputError: a file is there and cannot be read, so that its reviews would be lost.
    """

    folder: Path
    files: Sequence[str]
    not_carried: str = NOT_CARRIED
    _rest: dict[str, gpd.GeoDataFrame] = field(default_factory=dict, init=False)
    _count: int = field(default=0, init=False)
    _joined: int = field(default=0, init=False)
    _split: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        for name in (*self.files, self.not_carried):
            self._read(name)

    def carried_to(
        self, frame: gpd.GeoDataFrame, file: str, known: Iterable[str], *, persistent_ids: bool = False
    ) -> gpd.GeoDataFrame:
        """``frame``, the new zones of ``file``, with what was entered in the earlier ones.

        The earlier file is read anew, because people may have gone on while the run was at work.

        Args:
            known: the fields of the layer; other columns were added by people.
            persistent_ids: whether zones keep their ids from run to run.
        """
        old, own = self._read(file, known)
        waiting = self._waiting(file)
        if len(waiting):
            fields = {name.lower() for name in (*known, *_IDENTIFYING, *_ADDED)}
            own = tuple(dict.fromkeys([*own, *own_columns(waiting, fields)]))
            old = waiting if old is None else _together([old, waiting])
        if old is None:
            return frame
        carried = carry_reviews(old, frame, own, persistent_ids=persistent_ids)
        kept = [name for name in (*_IDENTIFYING, *REVIEW_FIELDS, *own, "why_not_carried") if name in carried.rest]
        self._rest[file] = carried.rest[[*kept, carried.rest.geometry.name]].assign(from_file=file)
        self._count += carried.count
        self._joined += carried.joined
        self._split += carried.split
        return carried.frame

    def finish(self, stage: Stage, outputs: dict[str, Path], progress: Progress) -> dict[str, Any]:
        """Write what was not carried over, if there is any, add the file to ``outputs``, and report all of it.

        Returns:
            The facts for the run record.
        """
        before = self._read(self.not_carried)[0]
        others = [] if before is None else [before[~before["from_file"].isin(list(self._rest))]]
        rest = [part for part in (*self._rest.values(), *others) if len(part)]
        left = sum(len(part) for part in self._rest.values())
        if rest:
            frame = _together(rest)
            frame["geometry"] = [_multi(shape) for shape in frame.geometry]
            own = own_columns(frame, (*_IDENTIFYING, *_ADDED))
            write_layers(stage.path(self.not_carried), [Layer(frame, "reviews", "", "MultiPolygon", own)])
            outputs["reviews_not_carried"] = stage.final(self.not_carried)
        elif before is not None:
            stage.discard(self.not_carried)
        self._report(left, progress)
        return {"carried": self._count, "in_remarks": self._joined, "split": self._split, "not_carried": left}

    def _report(self, left: int, progress: Progress) -> None:
        if self._count:
            progress.info(f"What was entered for {_zones(self._count)} of the earlier results was carried over.")
        if self._split or self._joined:
            progress.warning(
                "Zones were split or merged since they were reviewed "
                f"({self._split} and {self._joined} reviews); what was entered for them is in their remarks: look at "
                "them again."
            )
        if left:
            progress.warning(
                f"What was entered for {_zones(left)} of the earlier results could not be carried over, because no "
                f"zone continues {'it' if left == 1 else 'them'}; it is kept in {self.not_carried}."
            )

    def _waiting(self, file: str) -> gpd.GeoDataFrame:
        """What an earlier run could not carry over of ``file``."""
        waiting = self._read(self.not_carried)[0]
        if waiting is None:
            return gpd.GeoDataFrame({"from_file": []}, geometry=[])
        return waiting[waiting["from_file"] == file].drop(columns=list(_ADDED))

    def _read(self, name: str, known: Iterable[str] = ()) -> tuple[gpd.GeoDataFrame | None, tuple[str, ...]]:
        """The layer of a file and the columns that people added; None if there is no such file."""
        path = self.folder / name
        if not path.exists():
            return None, ()
        try:
            with readable(path) as plain:
                layer = "reviews" if name == self.not_carried else _LAYER
                info = pyogrio.read_info(plain, layer=layer)
                frame = pyogrio.read_dataframe(plain, layer=layer)
                with closing(sqlite3.connect(f"{plain.absolute().as_uri()}?mode=ro", uri=True)) as database:
                    measured = guarded_columns(database, layer)
        except (OSError, RuntimeError, ValueError, CRSError, shapely.errors.GEOSException, sqlite3.Error) as error:
            raise InputError(
                f"{path} cannot be read, so what was entered in it would be lost; repair it, or move it elsewhere."
            ) from error
        for column, kind in zip(info["fields"], info["ogr_types"], strict=True):
            if kind == "OFTBinary":
                raise InputError(
                    f"{path} has a column {column} of binary values, which cannot be carried over; name files in a "
                    "column of text instead, or move it elsewhere."
                )
        for column, kind in zip(info["fields"], info["dtypes"], strict=True):
            if kind.startswith("int") and pd.api.types.is_float_dtype(frame[column].dtype):
                frame[column] = frame[column].astype("Int64")  # read as real because of gaps
        if not isinstance(frame, gpd.GeoDataFrame):
            frame = gpd.GeoDataFrame(frame, geometry=[None] * len(frame))
        for needed in _IDENTIFYING[:2] + (_ADDED if name == self.not_carried else ()):
            if needed not in frame:
                frame[needed] = ""
        return frame, own_columns(frame, (*known, *measured))


def _together(frames: Sequence[gpd.GeoDataFrame]) -> gpd.GeoDataFrame:
    """One table of several, in the reference system of the first; columns that differ in case only are one."""
    crs = frames[0].crs
    spelt: dict[str, str] = {}
    parts = []
    for frame in frames:
        part = frame.to_crs(crs) if crs is not None and frame.crs is not None and frame.crs != crs else frame
        part = part.rename_geometry("geometry") if part.geometry.name != "geometry" else part
        parts.append(part.rename(columns={name: spelt.setdefault(name.lower(), name) for name in part.columns}))
    names = list(dict.fromkeys(name for part in parts for name in part.columns))
    columns = {name: [v for part in parts for v in part.get(name, [None] * len(part))] for name in names}
    shapes = columns.pop("geometry")
    typed = {name: _typed(values) for name, values in columns.items()}
    return gpd.GeoDataFrame(typed, geometry=shapes, crs=crs)


def _typed(values: Sequence[Any]) -> pd.Series:
    """A column whose whole numbers stay whole though there are gaps."""
    column = pd.Series([None if pd.isna(v) else v for v in values], dtype=object)
    known = column.dropna()
    for is_kind, name in ((pd.api.types.is_bool, "boolean"), (pd.api.types.is_integer, "Int64")):
        if len(known) and all(map(is_kind, known)):
            return column.astype(name)
    return column.infer_objects()


def _multi(shape: Any) -> Any:
    return shapely.MultiPolygon([shape]) if isinstance(shape, shapely.Polygon) else shape


def _zones(count: int) -> str:
    return "one zone" if count == 1 else f"{count} zones"
