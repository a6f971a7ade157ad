"""Bond-graph text in, program out. The rooms, in the order of the pipeline, are listed in `README.md` of this folder."""
