"""Version of the package; `pyproject.toml` and `bondgraph.__version__` read it here."""

VERSION = "0.9.0"
