"""What looks at a run from beside: limits, numbers that are none, the energy, the choice of states."""
