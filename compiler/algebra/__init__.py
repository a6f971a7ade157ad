"""Expressions, the noun that every room from semantics to code shares."""
