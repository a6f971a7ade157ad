"""`multibody` blocks: parts and their attributes."""
