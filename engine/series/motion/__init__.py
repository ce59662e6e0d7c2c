"""Motion along the surface through the surveys of a series: positions, velocities, zones."""
