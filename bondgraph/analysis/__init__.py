"""Analyses of a model from its equations: equilibria, linear models, modes, responses, the port-Hamiltonian form."""
