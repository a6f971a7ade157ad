"""Numerical methods: arrays and functions of numbers in, arrays out; no program of a model."""
