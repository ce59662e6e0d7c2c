"""From a raw survey to ground points."""
