"""Resolution of names and quantities in each instance."""
