"""What a model is and does, read from its equations: rest, linear models, modes, responses, its port-Hamiltonian form."""
