"""Results of runs: numbers by the author's names, and their files."""
