"""Checks of an accepted step: work, zero crossings, singular poses ahead; in the subset that becomes machine code."""
