"""Texts for terminals and documents."""
