"""Parts of a phase: its start, its tolerances, its solution, its failures."""
