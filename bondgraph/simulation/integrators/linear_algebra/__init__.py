"""Linear algebra of the integrators: dense and sparse factors, orders of elimination, balancing; in the subset that becomes machine code."""
