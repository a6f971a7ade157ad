"""Presentation of models and results: texts, plots, diagrams, pages."""
