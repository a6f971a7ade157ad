"""Stepping in machine code: the subset that is compiled, and how a run uses it."""
