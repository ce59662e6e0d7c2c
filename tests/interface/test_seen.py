from slopewatch.interface import seen


def test_every_class_has_a_number_of_its_own_a_label_and_a_key():
    assert [seen.OUTSIDE, seen.COMPARED, seen.NOT_IN_FIRST, seen.NOT_IN_LATER] == [0, 1, 2, 3]
    assert [seen.NOT_IN_BOTH, seen.TOO_FEW, seen.EXCLUDED] == [4, 5, 6]
    assert list(seen.LABELS) == list(seen.KEYS) == list(range(7))
    assert len(set(seen.LABELS.values())) == len(set(seen.KEYS.values())) == 7
    assert seen.NODATA not in seen.LABELS


def test_what_was_not_seen_is_the_slope_without_what_was_compared():
    assert set(seen.NOT_SEEN) | {seen.OUTSIDE, seen.COMPARED} == set(seen.LABELS)
