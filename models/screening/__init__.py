"""Labels and zones of one cloud by the network or the threshold."""
