"""Modules loaded on import: nothing heavy by the facade, no solver and no computer algebra by a check."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.compiling import ROOT

HEAVY = ("numpy", "sympy", "scipy", "networkx", "lark", "matplotlib", "pandas", "click", "rich")


def loaded(code: str) -> set[str]:
    """The heavy packages after some code, in a fresh interpreter."""
    script = f"import sys\n{code}\nprint(*(m for m in {HEAVY!r} if m in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return set(done.stdout.split())


def test_the_facade() -> None:
    assert loaded("import bondgraph") == set()
    assert loaded("import bondgraph; dir(bondgraph); bondgraph.__all__") == set()


@pytest.mark.parametrize("model", ["manipulator.bg", "feed_forward.bg"])
def test_check(model: str) -> None:
    """Up to the equations: neither scipy nor sympy, and no arrays."""
    reading = "assert 'compiler.reduction.reduce' in sys.modules, 'the model was not read'"
    found = loaded(f"import bondgraph\nassert bondgraph.check('models/{model}') == ()\n{reading}")
    assert not found & {"scipy", "sympy", "matplotlib", "pandas", "numpy"}


def test_the_grammar_is_read_once() -> None:
    """lark makes the parser's tables; from then on they are kept."""
    checking = "import bondgraph\nassert bondgraph.check('models/manipulator.bg') == ()"
    loaded(checking)
    without_grammars = "import lark\nlark.Lark.__init__ = None"
    assert "lark" in loaded(f"{without_grammars}\n{checking}")


@pytest.mark.skipif("BONDGRAPH_WITHOUT_LLVM" in os.environ, reason="only native code is kept")
def test_a_model_seen_before_is_not_parsed() -> None:
    pytest.importorskip("llvmlite")
    running = "import bondgraph\nassert bondgraph.load('models/rlc.bg').simulate().steps > 0"
    loaded(running)
    assert not loaded(running) & {"lark", "sympy"}


@pytest.mark.skipif("BONDGRAPH_WITHOUT_LLVM" in os.environ, reason="only native code is kept")
@pytest.mark.parametrize("model", ["oscillator", "rlc"])
def test_a_second_run_needs_no_source_of_the_steps(model: str) -> None:
    """It has their machine code."""
    pytest.importorskip("llvmlite")
    code = f"import sys, bondgraph\nbondgraph.load('models/{model}.bg').simulate()\nprint(*sys.modules)"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    modules = [m.removeprefix("bondgraph.simulation.integrators.") for m in done.stdout.split()]
    rooms = ("steps", "acceptance", "dense_output", "compiled.advance", "compiled.sources")
    assert "outcomes" in modules and not [m for m in modules if m.startswith(rooms)]


def test_a_program_needs_no_scipy() -> None:
    found = loaded(
        "import bondgraph\nassert 'def derivative' in bondgraph.load('models/manipulator.bg').compilation().program.source"
    )
    assert not found & {"scipy", "matplotlib", "pandas", "sympy"}


def test_nothing_lasting_happens_on_import() -> None:
    """Every module of both packages can be imported alone, without a warning and without output."""
    modules = [
        ".".join(p.relative_to(ROOT).with_suffix("").parts)
        for package in ("compiler", "bondgraph")
        for p in sorted((ROOT / package).rglob("*.py"))
        if p.name not in ("__main__.py",)
    ]
    script = "import importlib\n" + "\n".join(
        f"importlib.import_module({m.removesuffix('.__init__')!r})" for m in modules
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_run_loads_no_page() -> None:
    """Nor what a server needs: who runs a model looks at numbers."""
    code = (
        "import sys, bondgraph\nbondgraph.load('models/rlc.bg').simulate(to='1 ms').summary()\n"
        "print(*(m for m in sys.modules if m.startswith(('bondgraph.presentation.page', 'http.server'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.split() == []


def test_many_runs_load_no_stage_of_the_compiler() -> None:
    """They are as many times one, with a program that is kept."""
    code = "import sys, bondgraph.studies.runs\nprint(*(m for m in sys.modules if m.startswith('compiler.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    stages = ("multibody", "causality", "equations", "reduction", "graph")
    assert done.stdout.split() and not [m for m in done.stdout.split() if m.split(".")[1] in stages]
