"""Expressions, the data structure that all rooms from semantics to code share."""
