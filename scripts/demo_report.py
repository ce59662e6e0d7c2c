"""Print what a run on a simulated survey found, compared with the truth: ``demo_report.py SURVEY RESULTS``."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import geopandas
import laspy
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.features import geometry_mask
from rasterio.warp import Resampling, reproject

CHANGED = 0.05
"""True change in metres from which a cell counts as changed; below 1 mm it counts as unchanged."""
UNCHANGED = 0.001

Row = tuple[str, str, str]


@dataclass(frozen=True)
class Maps:
    """True and found change on the grid of the results, metres; NaN where not measured, with the grid's cell area."""

    truth: NDArray[np.float64]
    found: NDArray[np.float64]
    transform: rasterio.Affine

    @property
    def measured(self) -> NDArray[np.bool_]:
        return np.isfinite(self.found) & np.isfinite(self.truth)

    @property
    def cell_area(self) -> float:
        return abs(self.transform.a * self.transform.e)


def read_maps(survey: Path, results: Path) -> Maps:
    """Both rasters, the truth brought to the grid of the results."""
    with rasterio.open(results / "elevation_change.tif") as raster:
        found = raster.read(1, masked=True).astype(float).filled(np.nan)
        transform, crs = raster.transform, raster.crs
    truth = np.full(found.shape, np.nan)
    with rasterio.open(survey / "truth_dz.tif") as raster:
        reproject(
            raster.read(1, masked=True).astype(float).filled(np.nan),
            truth,
            src_transform=raster.transform,
            src_crs=raster.crs,
            src_nodata=np.nan,
            dst_transform=transform,
            dst_crs=crs,
            dst_nodata=np.nan,
            resampling=Resampling.nearest,
        )
    return Maps(truth, found, transform)


def read_matrix(path: Path) -> NDArray[np.float64]:
    return np.array(json.loads(path.read_text(encoding="utf-8"))["matrix"])


def moved(matrix: NDArray[np.float64], xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    return xyz @ matrix[:3, :3].T + matrix[:3, 3]


def rms(vectors: NDArray[np.float64]) -> float:
    """Root of the mean squared length of ``vectors`` (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def registration_rows(survey: Path, results: Path) -> list[Row]:
    """How far the found motion leaves the later survey's ground from where the true motion puts it."""
    ground = next((results / "clouds").glob("2025-05-01_ground.laz"))
    xyz = laspy.read(ground).xyz[::20]
    true = moved(read_matrix(survey / "truth_transform.json"), xyz)
    found = moved(read_matrix(results / "transform.json"), xyz)
    return [
        ("offset of the later survey, rms", f"{1000 * rms(xyz - true):.1f} mm", f"{1000 * rms(xyz - found):.1f} mm"),
        ("left after registration, rms", "0 mm", f"{1000 * rms(found - true):.2f} mm"),
    ]


def change_rows(maps: Maps) -> list[Row]:
    """The mean per-cell change where the truth has none, and where it has some."""
    error = maps.found - maps.truth
    still = maps.measured & (np.abs(maps.truth) < UNCHANGED)
    rows = [
        ("mean change of unchanged cells", "0 mm", f"{1000 * np.mean(error[still]):+.1f} mm"),
        (
            "scatter of unchanged cells (NMAD)",
            "0 mm",
            f"{1482.6 * np.median(np.abs(error[still] - np.median(error[still]))):.1f} mm",
        ),
    ]
    for word, side in (("raised", maps.truth > CHANGED), ("lowered", maps.truth < -CHANGED)):
        cells = maps.measured & side
        if cells.any():
            name = f"mean change of cells {word} > {100 * CHANGED:.0f} cm"
            rows.append((name, f"{np.mean(maps.truth[cells]):+.3f} m", f"{np.mean(maps.found[cells]):+.3f} m"))
    return rows


def zone_rows(survey: Path, results: Path, maps: Maps) -> list[Row]:
    """How much of the true change lies in zones, and the zones' volumes compared with the true ones of their cells."""
    zones = geopandas.read_file(results / "zones.gpkg", layer="zones")
    changes = json.loads((survey / "truth.json").read_text(encoding="utf-8"))["changes"]
    rows = [("hazard zones", f"{len(changes)} changes", f"{len(zones)} zones")]
    if zones.empty:
        return rows
    # A zone's volume is that of its footprint, so the truth is summed there.
    footprints = geopandas.read_file(results / "zones.gpkg", layer="footprints")
    metrics = json.loads((results / "run.json").read_text(encoding="utf-8"))["metrics"]
    for word, sign, name in (("raised", 1, "vol_gain"), ("lowered", -1, "vol_loss")):
        outlines = footprints.geometry[sign * footprints["vol_net_m3"] > 0]
        there = ~geometry_mask(outlines, maps.found.shape, maps.transform) if len(outlines) else np.zeros(0, dtype=int)
        true = sign * np.sum(maps.truth[there]) * maps.cell_area
        volume, error = metrics[f"{name}_m3"], metrics[f"{name}_err_m3"]
        rows.append((f"volume {word} in the zones", f"{true:.2f} m3", f"{volume:.2f} m3 (+- {error:.2f})"))
    inside = ~geometry_mask(zones.geometry, maps.found.shape, maps.transform) & maps.measured
    within = inside & (np.abs(maps.truth) > CHANGED)
    everywhere = maps.measured & (np.abs(maps.truth) > CHANGED)
    if everywhere.any():
        share = np.count_nonzero(within) / np.count_nonzero(everywhere)
        rows.append((f"cells changed > {100 * CHANGED:.0f} cm that lie in a zone", "100 %", f"{100 * share:.0f} %"))
    return rows


def screening_rows(results: Path, maps: Maps) -> list[Row]:
    """How many screened zones moved in their direction by the truth, and how many are said to have."""
    path = results / "screened_zones.gpkg"
    if not path.is_file():
        return []
    zones = geopandas.read_file(path, layer="zones")
    confirmed, moved = (zones["confirmed"] == "confirmed").to_numpy(), np.zeros(len(zones), dtype=bool)
    for number, (kind, outline) in enumerate(zip(zones["kind"], zones.geometry, strict=True)):
        inside = ~geometry_mask([outline], maps.found.shape, maps.transform) & maps.measured
        sign = 1 if kind == "uplift" else -1
        moved[number] = inside.any() and sign * np.mean(maps.truth[inside]) > CHANGED
    name = f"screened zones that moved > {100 * CHANGED:.0f} cm their way"
    return [
        ("screened zones", "", f"{len(zones)} zones"),
        (name, str(moved.sum()), f"{(moved & confirmed).sum()} confirmed"),
        ("other screened zones", str((~moved).sum()), f"{(~moved & confirmed).sum()} confirmed"),
    ]


def run_rows(survey: Path, results: Path) -> list[Row]:
    """What read the clouds, vegetation cover, cells measured in both epochs, time."""
    record = json.loads((results / "run.json").read_text(encoding="utf-8"))
    truth = json.loads((survey / "truth.json").read_text(encoding="utf-8"))
    metrics, pdal = record["metrics"], record["pdal"]
    return [
        ("clouds read and clipped by", "", pdal.get("instead") or f"PDAL {pdal['version']}"),
        (
            "vegetation cover",
            f"{100 * truth['vegetation_cover_of_slope']:.1f} %",
            f"{100 * metrics['reference_vegetation_cover']:.1f} %",
        ),
        ("cells with ground in both surveys", "", f"{100 * metrics['common_cell_rate']:.1f} %"),
        ("level of detection, median", "", f"{1000 * metrics['lod_median_m']:.0f} mm"),
        ("seconds", "", f"{record['seconds']:.1f}"),
    ]


def main(survey: Path, results: Path) -> None:
    out = sys.stdout
    out.write("\nOutputs\n")
    for path in sorted(path for path in results.rglob("*") if path.is_file()):
        out.write(f"  {path.stat().st_size / 1024:9,.0f} KB  {path}\n")
    maps = read_maps(survey, results)
    rows = registration_rows(survey, results)
    rows += change_rows(maps)
    rows += zone_rows(survey, results, maps)
    rows += screening_rows(results, maps)
    rows += run_rows(survey, results)
    width = max(len(name) for name, _, _ in rows)
    out.write(f"\n  {'':{width}}  {'truth':>12}  found\n")
    for name, true, found in rows:
        out.write(f"  {name:{width}}  {true:>12}  {found}\n")
    out.write(f"\nThe picture: {(results / 'heatmap.png').resolve()}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
