"""Mechanisms with closed loops in a run: held on their constraints, over singular poses."""
