"""Algebraic loops by themselves: their solutions, and whether there are others."""
