"""``slopewatch batch``: the slopes of a corridor, each in a process of its own, here or on a cluster."""
