"""CPU time and peak memory of each stage of one large model, in a process of its own; `bench_large_models.py` makes its tables of them.

    python tests/benchmarks/large_model_stages.py rc_ladder_array 10000

prints a line for each stage: its name, CPU seconds, peak memory of the process up to its end in MB.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

import bondgraph  # noqa: E402
from bondgraph.compiled_model import LIBRARY  # noqa: E402
from bondgraph.native import compiled_safely  # noqa: E402
from compiler.api import Compilation, Source, uncollected  # noqa: E402
from tests.benchmarks import large_models  # noqa: E402

ALL = 10**12  # parts


def timed(name: str, action: Callable[[], object]) -> None:
    began = time.process_time()
    action()
    took, peak = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{name:12} {took:9.3f} {peak:9.0f}", flush=True)


def main(kind: str, sections: int) -> None:
    text = f"# {time.time_ns()}\n{getattr(large_models, kind)(sections)}"
    model = bondgraph.load(text)
    compilation = Compilation(Source("text", text), model.scene(), LIBRARY, most_parts=ALL)
    with uncollected():
        timed("parse", lambda: compilation.tree)
        timed("semantics", lambda: compilation.whole_graph)
        timed("graph", lambda: compilation.graph)
        timed("causality", lambda: compilation.causal)
        timed("equations", lambda: compilation.equations)
        timed("reduction", lambda: compilation.state_space)
        timed("codegen", lambda: compilation.lowered)
        timed("native", lambda: compilation.native(compiled_safely))
        timed("facts", lambda: (compilation.facts, compilation.certificate))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
