"""The fields, kinds and severities of hazard zones."""

from __future__ import annotations

from ..vector.cell_polygons import field_kinds

# Name and kind of every field, in the order of the attribute table. Text is never NULL; a number that is not known is.
FIELDS = field_kinds("""
    text: zone_id slope_id route
    real: chain_from chain_to
    text: side carriageway
    real: offset_m offset_mid_m
    text: location location_note epoch_from epoch_to
    integer: days
    text: kind movement severity
    real: confidence dz_mean_m dz_min_m dz_max_m dz_p95_m area_m2
    integer: n_cells
    real: zone_net_m3 zone_err_m3
    real: vol_loss_m3 vol_gain_m3 vol_net_m3 vol_err_m3 vol_low_m3 vol_high_m3 vol_area_m2 vol_measured
    real: n_eff lod95_m rate_mm_day rate_err slope_deg
    real: motion_m motion_err_m azimuth_deg plunge_deg normal_m normal_err_m relief_kept movement_conf sank_m2 bulged_m2
    integer: n_pts_min n_epochs_confirmed
    text: review_status reviewer remarks method run_id
""")
UNSURE = "unsure"
"""In place of a severity, where noise alone may have made the zone."""
SEVERITIES = ("high", "moderate", "low", UNSURE)
KINDS = ("subsidence", "uplift")
"""By the heights."""
SLIDING = "sliding"
"""The kind of ground that slid along its surface, whatever its heights did."""
ZONE_KINDS = (*KINDS, SLIDING)
CHANCE, PLANTS, SEASON, SMALL = "chance", "vegetation", "season", "small"
REASONS = (CHANCE, PLANTS, SEASON, SMALL)
"""Noise may have made it; within the error by vegetation; the vegetation differs as much; sure, but below the least
size of a zone."""
UNSURE_FIELDS = field_kinds("""
    text: group_id reason kind
    real: dz_mean_m dz_err_m area_m2 confidence
    integer: n_cells
""")
NOT_SEEN_FIELDS = field_kinds("""
    text: reason
    real: area_m2
""")
