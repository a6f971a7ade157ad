"""Integration in machine code: functions in the subset of Python that is compiled, and their use in a run."""
