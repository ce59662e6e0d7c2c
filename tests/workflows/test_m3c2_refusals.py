"""What m3c2 refuses in one sentence, and what it warns of."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.tests.builders.steep_pair import region, run, steep, write
from slopewatch.workflows.m3c2 import parse_direction


class TestRefusals:
    def refused(self, folder: Path, *arguments, match: str, **given) -> str:
        before = {p.name for p in folder.iterdir()}
        with pytest.raises(InputError, match=match) as caught:
            run(*arguments, folder / "out.laz", **given)
        assert {p.name for p in folder.iterdir()} == before
        assert str(caught.value).endswith(".")
        return str(caught.value)

    def test_the_same_file_twice(self, pair, tmp_path):
        copy = shutil.copy(pair[0], tmp_path / "other.laz")
        self.refused(tmp_path, pair[0], Path(copy), match="are the same cloud")

    def test_reversed_dates(self, pair, tmp_path):
        self.refused(tmp_path, pair[1], pair[0], match="reversed order")

    def test_no_overlap_names_both_extents(self, pair, tmp_path):
        away = write(tmp_path / "away.laz", steep(2000, 3, shift=(100.0, 0, 0)))
        sentence = self.refused(tmp_path, pair[0], away, match="do not overlap")
        assert "x 500000.0 to 500012.0" in sentence
        assert "x 500100.0 to 500112.0" in sentence

    def test_no_point_in_any_cylinder(self, pair, tmp_path):
        high = write(tmp_path / "high.laz", steep(9000, 3, shift=(0.0, 0, 2.8)))
        self.refused(tmp_path, pair[0], high, match="--half-length", half_length=1.0)

    @pytest.mark.parametrize(
        ("crs", "match"),
        [(None, "no coordinate reference system"), (4326, "geographic"), (32650, "different reference")],
    )
    def test_reference_systems(self, pair, tmp_path, crs, match):
        other = write(tmp_path / "other.laz", steep(2000, 3), crs=crs)
        self.refused(tmp_path, pair[0], other, match=match)
        self.refused(tmp_path, *pair, match=match, core=other)

    def test_normals_that_are_not_there(self, pair, tmp_path):
        self.refused(tmp_path, *pair, match="needs --core", normals="given")
        core = write(tmp_path / "core.laz", steep(100, 3))
        self.refused(tmp_path, *pair, match="core.laz' has no dimension NormalX", normals="given", core=core)

    def test_a_region_without_the_slope_or_without_core_points(self, pair, tmp_path):
        far = region(tmp_path / "far.gpkg", shapely.box(5e5 + 90, 3.5e6, 5e5 + 99, 3.5e6 + 9))
        sentence = self.refused(tmp_path, *pair, match="lies outside of the cloud", roi=far)
        assert "far.gpkg" in sentence
        near = region(tmp_path / "near.gpkg", shapely.box(5e5 + 6, 3.5e6, 5e5 + 9, 3.5e6 + 9))
        core = write(tmp_path / "core.laz", steep(100, 3) * [0, 0, 0] + [5e5 + 1, 3.5e6 + 1, 50])
        self.refused(tmp_path, *pair, match="core.laz' has no core point inside", roi=near, core=core)
        sliver = region(tmp_path / "sliver.gpkg", shapely.box(5e5 + 6, 3.5e6 + 1, 5e5 + 6.001, 3.5e6 + 1.001))
        self.refused(tmp_path, *pair, match="Fewer than 10 points lie where the region", roi=sliver)

    @pytest.mark.parametrize("text", ["up", "0,0,0", "0,1", "1,2,nan", ""])
    def test_a_direction_that_is_none(self, pair, tmp_path, text):
        self.refused(tmp_path, *pair, match="orientation is", orientation=text)

    def test_output_equal_to_an_input_and_a_raster_too_large(self, pair, tmp_path):
        first = Path(shutil.copy(pair[0], tmp_path / "out.laz"))
        with pytest.raises(InputError, match="also an input"):
            run(first, pair[1], first)
        first.unlink()
        self.refused(tmp_path, *pair, match="--distance-cell", distance_cell=1e-3)


def test_a_datum_shift_and_change_beyond_the_cylinder_are_named(pair, tmp_path):
    progress = Progress()
    high = write(tmp_path / "high.laz", steep(14_000, 3, shift=(0.0, 0, 0.5)))
    run(pair[0], high, tmp_path / "a.laz", progress=progress)
    assert any("datum or height bias" in sentence for sentence in progress.warnings)
    progress = Progress()
    run(*pair, tmp_path / "b.laz", progress=progress, half_length=0.15)
    assert any("only beyond the cylinder" in sentence for sentence in progress.warnings)


def test_directions_are_read():
    assert parse_direction("0, -1,0.5").tolist() == [0, -1, 0.5]
