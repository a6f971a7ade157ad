"""What happens at instants: conditions flip, events act, junctions go on and off; signals that are delayed."""
