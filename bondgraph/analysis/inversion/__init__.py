"""Inversion: inputs for given outputs, at equilibrium and along a trajectory. Import its files directly, so that each loads only its needs."""
