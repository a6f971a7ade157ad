"""Instances, elements, laws and events; bonds between nodes."""
