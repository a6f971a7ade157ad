"""Expressions with units, compiled once for each place in the text."""
