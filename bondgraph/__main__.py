"""`python -m bondgraph`: the command line."""

from __future__ import annotations

from .commands import main

if __name__ == "__main__":
    main()
