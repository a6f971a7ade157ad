"""Programs as text for others: one file for each target."""
