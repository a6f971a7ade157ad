"""Modal truncation: oscillating modes faster than the bandwidth of a run are removed from the state and reported."""
