"""Initialization: consistent initial states, equilibria, assembly of closed loops, and magnitudes of the states."""
