"""The C target: source without dependencies, for embedding."""
