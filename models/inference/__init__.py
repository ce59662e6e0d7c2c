"""Labels and probabilities of points by the network."""
