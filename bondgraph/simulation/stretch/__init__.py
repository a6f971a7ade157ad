"""A smooth stretch of a run, stepped through."""
