"""Initialization: consistent initial states and the assembly of closed loops."""
