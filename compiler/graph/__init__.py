"""The bond graph itself."""
