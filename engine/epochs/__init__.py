"""What a survey is, and when two may be compared."""
