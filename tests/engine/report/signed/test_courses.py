"""The chart of a zone's course: motion along the surface stands in it where it is known."""

from __future__ import annotations

from slopewatch.engine.report.signed.courses import course_drawing, has_motion

ROWS = [
    {"epoch": f"2025-0{n}-01", "dz_mean_m": -0.1 * n, "dz_err_m": 0.01, "vol_net_m3": -n, "vol_err_m3": 0.1}
    for n in (2, 3)
]
MOVED = [row | {"motion_m": 0.2, "motion_err_m": 0.02} for row in ROWS]


def axes_of(drawn: bytes) -> int:
    return drawn.count(b'<g id="axes_')


def test_motion_has_axes_of_its_own_only_where_it_is_known() -> None:
    assert not has_motion(ROWS)
    assert has_motion([ROWS[0], MOVED[1]])
    assert axes_of(course_drawing(ROWS, "2025-01-01", 52.0)) == 1
    assert axes_of(course_drawing([ROWS[0], MOVED[1]], "2025-01-01", 52.0)) == 2
