"""Integration methods for a smooth segment, in numpy and in machine code, and their linear algebra."""
