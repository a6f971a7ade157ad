"""Experiments: settings, initial values, steps and their attributes."""
