"""Zones through time on drawn groups whose fate is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.series.tracking import track_zones

SHAPE = (30, 40)


def drawn(*boxes: tuple[int, int, int, int], sign: int = -1):
    """Labels and signs of boxes (row from, row to, column from, column to)."""
    cells = np.zeros(SHAPE, dtype=bool)
    for top, bottom, left, right in boxes:
        cells[top:bottom, left:right] = True
    labels, _ = ndimage.label(cells, structure=np.ones((3, 3)))
    return labels.astype(np.int32), np.where(cells, sign, 0).astype(np.int8)


def track(*epochs, reach: int = 1):
    return {t.zone_id: t for t in track_zones([(i + 1, *e) for i, e in enumerate(epochs)], reach)}


def events(zone) -> list[tuple[int, str, tuple[str, ...]]]:
    return [(s.epoch, s.event, s.others) for s in zone.sightings]


def test_a_growing_zone_keeps_its_id_and_its_union():
    zones = track(drawn((5, 9, 5, 9)), drawn(), drawn((4, 10, 6, 14)))
    assert list(zones) == ["S001"]
    assert events(zones["S001"]) == [(1, "new", ()), (3, "continued", ())]
    mask = np.zeros(SHAPE, dtype=bool)
    mask[5:9, 5:9] = mask[4:10, 6:14] = True
    np.testing.assert_array_equal(zones["S001"].footprint, np.flatnonzero(mask))


def test_two_zones_merge_into_the_larger_and_the_other_is_named():
    zones = track(drawn((5, 8, 5, 8), (5, 11, 12, 20)), drawn((5, 11, 5, 20)), drawn((5, 11, 5, 20)))
    gone, keeper = zones["S001"], zones["S002"]
    assert events(keeper) == [(1, "new", ()), (2, "merged", ("S001",)), (3, "continued", ())]
    assert (gone.merged_into, events(gone)) == ("S002", [(1, "new", ())])
    assert len(keeper.footprint) == 6 * 15


def test_a_zone_splits_and_the_part_names_its_parent():
    zones = track(drawn((5, 15, 5, 25)), drawn((5, 15, 5, 16), (5, 15, 18, 25)), drawn((5, 15, 5, 16), (5, 15, 18, 25)))
    assert set(zones) == {"S001", "S002"}
    assert events(zones["S001"]) == [(1, "new", ()), (2, "split", ("S002",)), (3, "continued", ())]
    assert events(zones["S002"]) == [(2, "split", ("S001",)), (3, "continued", ())]
    assert zones["S002"].parent == "S001"
    shared = np.intersect1d(zones["S001"].footprint, zones["S002"].footprint)
    assert len(shared) == 0
    assert len(zones["S001"].footprint) + len(zones["S002"].footprint) == 10 * 20


def test_a_crumb_stays_part_of_its_zone():
    zones = track(drawn((5, 15, 5, 25)), drawn((5, 15, 5, 20), (5, 8, 23, 25)))
    assert set(zones) == {"S001"}
    assert len(zones["S001"].sightings[-1].cells) == 10 * 15 + 3 * 2


def test_raising_and_lowering_are_never_one_zone():
    zones = track(drawn((5, 9, 5, 9)), drawn((5, 9, 5, 9), sign=1))
    assert [z.sign for z in zones.values()] == [-1, 1]
    assert all(len(z.sightings) == 1 for z in zones.values())


def test_cells_beside_the_footprint_belong_to_it_within_the_reach_only():
    beside = drawn((5, 9, 5, 9)), drawn((5, 9, 9, 11))
    assert len(track(*beside, reach=2)) == 1
    assert len(track(*beside, reach=0)) == 2


def opposite(row: int):
    """Cells from that row on move the other way."""

    def alike(survey, cells, other, others):
        return (cells[0] // SHAPE[1] < row) == (others[0] // SHAPE[1] < row)

    return alike


def test_what_moves_the_other_way_is_no_crumb_of_a_zone():
    # the second group touches the first one's corner
    labels, signs = drawn((5, 15, 5, 25), (15, 17, 25, 27))
    labels[15:17, 25:27] = 2
    before = drawn((5, 15, 5, 25))
    alone = track_zones([(1, *before), (2, labels, signs)], 1)
    assert [len(zone.sightings[-1].cells) for zone in alone] == [204]
    zone, other = track_zones([(1, *before), (2, labels, signs)], 1, opposite(15))
    assert (len(zone.sightings[-1].cells), len(other.sightings[-1].cells)) == (200, 4)
    assert (other.parent, events(other)) == ("", [(2, "new", ())])


def test_what_moves_the_other_way_within_a_footprint_is_split_off():
    before = drawn((5, 17, 5, 25))
    labels, signs = drawn((5, 15, 5, 25), (15, 17, 5, 8))
    labels[15:17, 5:8] = 2
    zone, other = track_zones([(1, *before), (2, labels, signs)], 1, opposite(15))
    assert other.parent == zone.zone_id
    assert len(zone.sightings[-1].cells) == 200


def test_zones_that_move_in_other_ways_do_not_merge():
    labels, signs = drawn((5, 15, 5, 25), (15, 20, 5, 15))
    labels[15:20, 5:15] = 2
    grown = drawn((5, 17, 5, 25))
    same = track_zones([(1, labels, signs), (2, *grown)], 1)
    assert [zone.merged_into for zone in same] == ["", "S001"]
    zone, other = track_zones([(1, labels, signs), (2, *grown)], 1, opposite(15))
    assert (zone.merged_into, other.merged_into) == ("", "")
    assert [s.epoch for s in other.sightings] == [1]


@pytest.mark.parametrize("seed", range(5))
def test_a_later_survey_changes_no_earlier_id(seed):
    rng = np.random.default_rng(seed)
    epochs = []
    for _ in range(6):
        cells = ndimage.uniform_filter(rng.normal(size=SHAPE), 5) > 0.15
        labels, _ = ndimage.label(cells)
        epochs.append((labels.astype(np.int32), np.where(cells, -1, 0).astype(np.int8)))
    before, after = track(*epochs[:5]), track(*epochs)
    assert list(after)[: len(before)] == list(before)
    for name, zone in before.items():
        assert events(after[name])[: len(zone.sightings)] == events(zone)
        if zone.merged_into:
            assert after[name].merged_into == zone.merged_into
    living = [z.footprint for z in after.values() if not z.merged_into]
    together = np.concatenate(living)
    assert len(np.unique(together)) == len(together)


def test_nothing_significant_gives_no_zone():
    assert track(drawn(), drawn()) == {}
    assert track_zones([], 1) == ()
