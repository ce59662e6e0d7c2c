"""More than two surveys: zones through time, velocity, alerts."""
