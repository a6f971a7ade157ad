"""Magnitudes of the states, from a pilot run."""
