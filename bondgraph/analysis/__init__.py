"""What a model is, read from its equations: its port-Hamiltonian form."""

from .port_hamiltonian import PortHamiltonian, SymbolicPortHamiltonian, port_hamiltonian, symbolic_port_hamiltonian

__all__ = ["PortHamiltonian", "SymbolicPortHamiltonian", "port_hamiltonian", "symbolic_port_hamiltonian"]
