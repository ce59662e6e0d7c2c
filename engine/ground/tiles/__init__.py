"""Ground of clouds that are larger than memory, in tiles with a halo."""
