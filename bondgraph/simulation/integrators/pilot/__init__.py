"""Pilot run: its steps and their loop, in the subset that becomes machine code."""
