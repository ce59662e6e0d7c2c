"""What appeared or vanished above the ground between two surveys: boulders, walls, vehicles, vegetation."""
