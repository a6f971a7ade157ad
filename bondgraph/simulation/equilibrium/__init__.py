"""Equilibria: states at which all rates vanish."""
