from __future__ import annotations

import dataclasses
import re

import pytest
from slopewatch.interface import parameters
from slopewatch.interface.parameters import (
    AUTO,
    PROFILES,
    GridChangeParameters,
    GroundParameters,
    ParameterError,
    ParameterSet,
    command_sets,
    given,
)
from slopewatch.interface.parameters import change as change_module
from slopewatch.interface.parameters import registration as registration_module
from slopewatch.interface.parameters import screening as screening_module
from slopewatch.workflows.settings import DistanceSettings, ScreeningSettings, SeriesSettings, Settings

GROUPS = [
    g
    for g in vars(parameters).values()
    if isinstance(g, type) and issubclass(g, ParameterSet) and g not in (ParameterSet, GridChangeParameters)
]
SPECIFICATIONS = [(g, s) for g in GROUPS for s in g.specifications()]


@pytest.mark.parametrize(("group", "specification"), SPECIFICATIONS, ids=lambda v: getattr(v, "name", ""))
def test_every_parameter_is_described_and_its_bounds_hold(group, specification):
    assert specification.help.endswith(".")
    assert len(specification.help) > 15
    assert specification.label[0].isupper()
    group(**{specification.name: specification.default})
    if specification.minimum is not None:
        group(**{specification.name: specification.kind(specification.minimum)})
        with pytest.raises(ParameterError, match=specification.name):
            group(**{specification.name: specification.minimum - 2})  # -1 may stand for auto
    if specification.maximum is not None:
        with pytest.raises(ParameterError, match=specification.name):
            group(**{specification.name: specification.maximum + 1})
    if specification.choices:
        assert specification.default in specification.choices
        with pytest.raises(ParameterError, match=re.escape(specification.choices[0])):
            group(**{specification.name: "neither"})


@pytest.mark.parametrize("value", ["a lot", None, float("nan"), float("inf"), True, [1], 10**400])
def test_values_that_are_no_number_are_refused(value):
    with pytest.raises(ParameterError, match="cloth_resolution"):
        GroundParameters(cloth_resolution=value)


@pytest.mark.parametrize("value", [1.5, "x", True])
def test_values_that_are_no_whole_number_are_refused(value):
    with pytest.raises(ParameterError, match="rigidness"):
        GroundParameters(rigidness=value)


COMMANDS = {name: sets for name, sets in vars(command_sets).items() if name.isupper() and not name.startswith("_")}


@pytest.mark.parametrize("command", COMMANDS)
def test_names_are_unique_over_the_sets_of_a_command(command):
    names = [s.name for group in COMMANDS[command] for s in group.specifications()]
    assert len(names) == len(set(names)) > 0


def test_every_set_belongs_to_a_command_and_has_a_name_in_records():
    assert {group for sets in COMMANDS.values() for group in sets} == set(GROUPS)
    for sets in COMMANDS.values():
        names = [group.record_name for group in sets]
        assert "" not in names
        assert len(names) == len(set(names))


@pytest.mark.parametrize("bundle", [Settings, ScreeningSettings, DistanceSettings, SeriesSettings])
def test_bundles_call_their_sets_as_records_do(bundle):
    for name, group in vars(bundle()).items():
        assert group.record_name == name


AUTOMATIC = [(g, s) for g, s in SPECIFICATIONS if s.automatic]


@pytest.mark.parametrize(("group", "specification"), AUTOMATIC, ids=lambda v: getattr(v, "name", ""))
def test_what_is_left_to_the_data_is_a_word_an_empty_field_and_the_number_of_earlier_dialogs(group, specification):
    s = specification
    assert s.default == getattr(group(), s.name) == AUTO
    assert s.auto_number == (-1 if s.minimum == 0 else 0)
    assert (s.field_default, s.field_minimum) == (None, s.auto_number)
    assert s.field_label == (f"{s.label} ({s.unit})" if s.unit else s.label)
    for value in (AUTO, s.auto_number, float(s.auto_number)):
        assert getattr(group(**{s.name: value}), s.name) == AUTO
    assert given(getattr(group(**{s.name: s.minimum}), s.name)) == s.minimum
    assert given(AUTO) is None
    for value in ("automatic", s.auto_number - 0.001, True):
        with pytest.raises(ParameterError, match=rf"{s.name} is .*, or auto$"):
            group(**{s.name: value})


def test_these_numbers_are_left_to_the_data():
    assert {s.name for _, s in AUTOMATIC} == {
        "azimuth", "ground_share", "ground_scatter",
        "cell", "largest_cell", "registration_error", "normal_scale", "projection_scale", "half_length",
        "core_spacing", "distance_cell", "memory_limit", "ground_memory", "colour_range", "learning_rate", "batch",
        "minutes", "threads", "area", "density", "memory_budget", "region_cell", "simplification", "detail",
        "surface_error",
    }  # fmt: skip


def test_the_last_epoch_is_screened_with_the_same_parameters_but_its_ground_is_extracted_already():
    own, whole = screening_module.LastEpochParameters, screening_module.ScreeningParameters
    assert own.specifications()[0].name == "screen_last_epoch"
    assert {s for s in whole.specifications() if s.name != "ground"} == set(own.specifications()[1:])
    assert own().ground == "as_is"
    # The published network is other weights, which no parameter turns these into.
    assert own.record_name == whole.record_name == "screening"
    assert "screening" not in PROFILES["paper"]


def test_paper_profile_holds_the_published_settings():
    ground = GroundParameters.build(profile="paper")
    assert (ground.slope_aligned, ground.cloth_resolution, ground.rigidness) == (False, 0.1, 1)
    assert (ground.time_step, ground.class_threshold) == (0.5, 0.05)
    registration = registration_module.RegistrationParameters.build(profile="paper")
    assert (registration.method, registration.maximum_correspondence, registration.registration_iterations) == (
        "icp",
        0.10,
        200,
    )
    change = change_module.ChangeParameters.build(profile="paper")
    assert (change.cell, change.cell_value, change.adaptive, change.grows) == (0.1, "mean", False, False)
    series = change_module.GridChangeParameters.build(profile="paper")
    assert (series.cell, series.cell_value, series.calibrate) == (0.1, "mean", False)


def test_cells_grow_by_default_where_they_can():
    group = change_module.ChangeParameters
    assert group().grows
    assert not group(adaptive=False).grows
    assert group(cell=0.8).grows
    assert group(cell=1.0).grows
    one_size = group(cell=1.0, largest_cell=1.6)
    for change, why in ((one_size, "1 m leave no room"), (group(cell_value="mean"), "are means")):
        assert not change.grows
        assert why in change.why_one_size


def test_cells_of_one_size_have_the_same_parameters_but_for_growth():
    own, whole = change_module.GridChangeParameters, change_module.ChangeParameters
    growing = {"adaptive", "target_level", "largest_cell"}
    assert {s for s in whole.specifications() if s.name not in growing} == set(own.specifications())
    assert not own().grows


def test_values_given_override_the_profile_and_none_does_not():
    built = GroundParameters.build({"cloth_resolution": 0.3, "rigidness": None, "cell": 9}, "paper")
    assert built.cloth_resolution == 0.3
    assert built.rigidness == 1
    with pytest.raises(ParameterError, match="profile"):
        GroundParameters.build({}, "best")


def test_profiles_name_only_what_exists():
    groups = {g.record_name: {f.name for f in dataclasses.fields(g)} for g in GROUPS}
    for profile in PROFILES.values():
        for group, values in profile.items():
            assert set(values) <= groups[group]
