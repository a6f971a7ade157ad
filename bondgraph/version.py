"""Version of the package; `pyproject.toml` and `bondgraph.__version__` read it here."""

VERSION = "1.0.0"
