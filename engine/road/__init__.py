"""Where things lie along a road: centrelines, chainages, and the places of zones and regions on them."""
