"""What inputs give these outputs: at rest, and along a trajectory. Imported by file, so that each loads what it needs."""
