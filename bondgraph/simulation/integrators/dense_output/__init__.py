"""States within the last step, in the subset that becomes machine code."""
