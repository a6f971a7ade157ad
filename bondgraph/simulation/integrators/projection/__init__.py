"""Projection of states on the constraints of closed loops, in the subset that becomes machine code."""
