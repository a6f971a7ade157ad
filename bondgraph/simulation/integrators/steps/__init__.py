"""One step of each method, in the subset that becomes machine code."""
