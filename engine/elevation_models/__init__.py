"""Elevation models of several dates: on one grid, coregistered, with errors that the terrain explains."""
