"""Integration over a segment: the loop over steps, its machine code, and its use in a run."""
