"""The numpy target: readable source, the reference for all others."""

from .generate import generate_program

__all__ = ["generate_program"]
