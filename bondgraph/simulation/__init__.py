"""From a program to a result: instants at which to stop, magnitudes, the solver, the energy balance."""
