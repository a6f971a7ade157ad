"""All benchmarks by one command; each writes a table and pictures into results/.

python -m tests.benchmarks                      all
python -m tests.benchmarks NAME [WHAT …]        one of them, or some of its parts
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

NAMES = (
    "work_precision",
    "targets",
    "native",
    "fourbars",
    "large_models",
    "large_files",
    "state_equations",
    "pages",
    "language_service",
    "diagrams",
    "tolerances",
    "errors",
)
WITH_PARTS = ("targets", "work_precision")


def main(arguments: Sequence[str]) -> int:
    name, *parts = arguments or [""]
    if name and name not in NAMES:
        print(f"there is no benchmark `{name}`; there are: {', '.join(NAMES)}", file=sys.stderr)
        return 2
    for each in [name] if name else NAMES:
        module = importlib.import_module(f"tests.benchmarks.bench_{each}")
        if each in WITH_PARTS:
            module.main(parts)
        else:
            module.main()
    return 0


sys.exit(main(sys.argv[1:]))
