"""The panel: draw areas, go through the zones of a run, look at their sections and time series, write the report."""
