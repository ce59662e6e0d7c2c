"""Normal quantiles, robust scatter, quantiles, window sums, variogram. Knows no coordinates."""
