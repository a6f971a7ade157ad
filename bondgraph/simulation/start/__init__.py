"""Where a run begins: consistent starts, equilibria, closed loops put together; how large the states are going to be."""
