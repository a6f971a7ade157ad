"""Monitors of a run: limits, values that are not finite, the energy balance, the state selection."""
