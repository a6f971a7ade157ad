"""Integration of the smooth segments of a run."""
