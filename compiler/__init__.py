"""Compiler of bond-graph text to programs. `README.md` of this folder lists the rooms in the order of the pipeline."""
