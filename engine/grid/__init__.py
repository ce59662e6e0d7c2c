"""Points into cells, cells that grow, GeoTIFF."""
