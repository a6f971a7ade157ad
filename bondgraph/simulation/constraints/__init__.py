"""Mechanisms with closed loops in a run: projection on their constraints, and crossing of singular poses."""
