"""What is faster than the bandwidth of a run is left out where it rings, and told."""
