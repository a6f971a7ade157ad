"""Simulation: from a program to a result, with output instants, magnitudes, the integrator and the energy balance."""
