"""A finished run's results as files of other systems: GIS, drawings, road design, catalogues."""
