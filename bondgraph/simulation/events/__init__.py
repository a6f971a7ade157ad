"""Hybrid behaviour at instants: zero crossings of conditions, events, junctions that switch; and delayed signals."""
