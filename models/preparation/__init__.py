"""Points to what the network takes."""
