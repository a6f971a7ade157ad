"""Batches: many runs of one program, whose stages are array operations over all runs, and native calls for each."""
