"""Algebraic loops solved separately from the integration: their solutions, and a search for others."""
