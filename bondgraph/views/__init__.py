"""Pictures and pages of models and results."""
