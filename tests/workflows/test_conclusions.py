"""The sentences with which a run ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from slopewatch.cli.program import cli
from slopewatch.engine.core.run_result import RunResult
from slopewatch.tests.cli.test_help import EVERY
from slopewatch.workflows import conclusions
from slopewatch.workflows.conclusions import MOST, conclusion

FOLDER = Path("/results")
FILES = {"zones": FOLDER / "zones.gpkg", "report": FOLDER / "report.html", "run": FOLDER / "run.json"}
CHANGE = {
    "zone_count": 2, "zone_area_m2": 33.568, "vol_loss_m3": 1.8741, "vol_loss_err_m3": 0.1656, "vol_gain_m3": 0.0,
    "zone_net_m3": -1.2, "footprint_area_m2": 48.1, "footprint_net_m3": -1.8741,
    "largest_sink_m": -0.3007, "largest_rise_m": 0.0, "compared_share": 0.8874, "not_in_later_share": 0.07,
    "too_few_share": 0.0426, "lod_median_m": 0.02946,
}  # fmt: skip
MOVED = {
    "registration_method": "robust", "registration_dx_m": -0.0192, "registration_dy_m": -0.17,
    "registration_dz_m": 12.5, "registration_error_m": 0.00315,
}  # fmt: skip


SLIDES = {
    "moving_zone_count": 2, "moving_area_m2": 80.0, "fastest_zone_m": 0.1823, "motion_measured_share": 0.634,
    "smallest_motion_median_m": 0.07,
}  # fmt: skip


def said(command: str, figures: dict[str, Any], *warnings: str, outputs: dict[str, Path] | None = None) -> list[str]:
    return conclusion(command, RunResult(FILES if outputs is None else outputs, figures, warnings))


def test_a_change_ends_with_what_was_found_where_it_lies_and_what_to_look_at() -> None:
    assert said("change", CHANGE) == [
        (
            "2 zones of significant change were found: 1.87 ± 0.17 m³ lost and 0 m³ gained over their footprints. "
            "The zones themselves cover 33.6 m² with a net volume of -1.2 m³, their footprints 48.1 m² with -1.87 m³."
        ),
        "The largest lowering in a zone is 0.301 m, the largest raising 0 m.",
        "89 % of the slope was compared; 7 % has no ground in the later survey.",
        "Change below the level of detection, 0.029 m in the median, cannot be distinguished from none.",
        "3 files were written to /results.",
        "Look first at report.html and zones.gpkg.",
        "There were no warnings.",
    ]


def test_an_inspection_also_says_how_the_survey_was_moved_and_what_its_shape_shows() -> None:
    screened = {"screened_zone_count": 3, "confirmed_zones": 1}
    biased, did = {"registration_vertical_bias_m": 0.101}, {"slid_zones": 1, "largest_slide_m": 0.2, "sank_zones": 1}
    found = said("inspect", {**CHANGE, **MOVED, **SLIDES, **screened, **biased, **did}, "One.", "Two.")
    assert len(found) == MOST
    assert found[1] == (
        "2 zones of motion along the surface were found, 80 m² in all; the largest motion of one is 0.182 m."
    )
    assert found[5].startswith("Of the zones, 1 slid along the surface, by up to 0.200 m; 1 sank")
    assert found[6] == (
        "The later survey was moved by -0.019 m to the east, -0.170 m to the north and 12.500 m upwards to fit the "
        "earlier one, with a standard error of 0.003 m in height."
    )
    assert found[7] == (
        "On stable ground the later survey lay 0.101 m higher than the earlier one: a vertical bias between the "
        "campaigns, which the registration took off, and no change."
    )
    assert found[8] == (
        "By its shape, 3 zones of the last survey look raised or lowered; the change confirms 1 of them."
    )
    assert found[-1] == "2 warnings were given, which the run record keeps; read them first."


def test_zones_that_all_slid_lost_nothing() -> None:
    found = said("change", {**CHANGE, "slid_zones": 2, "largest_slide_m": 0.2})
    assert found[0] == (
        "2 zones of significant change were found, 33.6 m² in all: what moved there slid along the surface, and no "
        "material was lost or gained."
    )
    assert not any("largest lowering" in sentence for sentence in found)


def test_a_bias_of_models_is_above_or_below() -> None:
    for bias, word in ((0.54, "above"), (-0.54, "below")):
        found = said("demchange", {**CHANGE, "bias_m": bias, "bias_error_m": 0.008})[0]
        assert found.startswith(f"The later model lay 0.540 ± 0.008 m {word} the earlier one on stable ground")


def test_a_simulation_names_what_moves_along_the_surface() -> None:
    figures = {"points_reference": 5, "points_cloud": 6, "changes": 0, "motions": 4, "largest_motion_m": 0.2}
    assert said("simulate survey", figures)[1] == (
        "Places whose ground moves along its surface in the later one: 4, by up to 0.200 m."
    )


def test_an_inspection_without_slides_says_where_none_can_be_seen() -> None:
    still = {**SLIDES, "moving_zone_count": 0}
    assert said("inspect", {**CHANGE, **still})[1] == (
        "No motion along the surface above the level of detection was found where it can be seen, on 63 % of the "
        "ground."
    )
    assert not any("along the surface" in line for line in said("inspect", CHANGE))


def test_single_vectors_are_named_with_what_chance_gives() -> None:
    single = {**SLIDES, "moving_zone_count": 0, "significant_vectors": 2, "chance_vectors": 3.4}
    assert said("inspect", {**CHANGE, **single, "chance_vectors_most": 7})[1] == (
        "No zone that moves along the surface was found. Single vectors that are significant: 2, no more than chance "
        "gives (3.4 expected, up to 7 on 95 % of still slopes)."
    )
    more = said("inspect", {**CHANGE, **single, "chance_vectors_most": 1})[1]
    assert "more than chance gives (3.4 expected, up to 1 on 95 % of still slopes); look where they lie." in more


def test_nothing_found_is_said_and_never_called_safe() -> None:
    found = said("inspect", {"zone_count": 0, "compared_share": 0.5, "lod_median_m": 0.02})
    assert found[0] == "No zone of change above the level of detection was found."
    assert "safe" not in " ".join(found)
    assert said("inspect", {"screened_zone_count": 0})[0].startswith("No zone looks raised or lowered")


def test_one_is_one() -> None:
    found = said("change", {**CHANGE, "zone_count": 1}, "Once.", outputs={"run": FOLDER / "run.json"})
    assert found[0].startswith("1 zone of significant change was found")
    assert found[-3:] == [
        "1 file was written to /results.",
        "Look first at run.json.",
        "1 warning was given, which the run record keeps; read them first.",
    ]


def test_the_folder_is_that_of_the_record_wherever_else_a_file_was_wanted() -> None:
    outputs = {"map": Path("/tmp/map.png"), "ground": FOLDER / "clouds" / "ground.laz", **FILES}
    assert said("change", CHANGE, outputs=outputs)[4] == "4 files were written to /results."


@pytest.mark.parametrize("command", [*EVERY, "a command of tomorrow"])
@pytest.mark.parametrize("figures", [{}, {"zone_count": None, "compared_share": float("nan"), "points": "many"}])
def test_a_figure_that_is_not_known_leaves_its_sentence_out(command: str, figures: dict[str, Any]) -> None:
    found = said(command, figures)
    assert 3 <= len(found) <= MOST
    for sentence in found:
        assert sentence.endswith(".")
        assert "None" not in sentence
        assert "nan" not in sentence


def test_what_lies_deeper_in_the_folder_is_named_with_its_path() -> None:
    """A hand-over holds rasters, layers and report in folders of their own."""
    given = {name: FOLDER / name for name in ("rasters/elevation_change.tif", "layers.gpkg", "report/report.html")}
    run = {"run": FOLDER / "run.json"}
    assert said("exportgis", {}, outputs={**given, **run})[-2] == "Look first at report/report.html and layers.gpkg."
    rasters = {"rasters/elevation_change.tif": FOLDER / "rasters" / "elevation_change.tif", **run}
    assert said("exportgis", {}, outputs=rasters)[-2] == "Look first at rasters/elevation_change.tif."
    archive = {"handover": FOLDER / "slope.zip", "run": FOLDER / "slope_run.json"}
    assert said("exportgis", {}, outputs=archive)[-2] == "Look first at slope.zip."


def test_a_command_may_say_its_own_sentences() -> None:
    result = RunResult(FILES, {"zone_count": 4}, (), ("A picture of 4 m² was drawn.",))
    assert conclusion("inspect", result)[0] == "A picture of 4 m² was drawn."
    assert conclusion("info", RunResult({}, {"points": 4})) == []


def test_every_entry_is_a_command() -> None:
    assert set(conclusions._FOUND) <= set(EVERY)
    assert cli.commands


@pytest.mark.parametrize(
    ("command", "figures", "words"),
    [
        (
            "topview",
            {"points": 9000, "cell_m": 0.5, "picture": "rgb", "density": 24.0, "ground": "estimate"},
            ["9,000 points became rasters with cells of", "the cloud's colours", "returns/m²", "a quick estimate"],
        ),
        ("suggestroi", {"area_m2": 3771.0, "area_share": 0.96, "points_share": 0.986}, ["96 % of the cloud's area"]),
        ("exportlabelstudio", {"pictures": 4, "regions": 7}, ["4 pictures with 7 regions"]),
        (
            "importlabelstudio",
            {"regions": 7, "tasks": 2, "polygons": 5, "area_m2": 12.5},
            ["7 regions of 2 tasks became 5 polygons"],
        ),
    ],
)
def test_what_is_drawn_on_and_drawn_is_said(command: str, figures: dict[str, Any], words: list[str]) -> None:
    found = said(command, figures)
    for sentence, wanted in zip(found, words, strict=False):
        assert wanted in sentence
    assert found[-1] == "There were no warnings."
