"""Interface to the compiler: the only module of the product that imports from it.

Names are imported at their first use, so that no unnecessary stage is loaded.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from compiler.algebra.affine import affine_parts
    from compiler.algebra.derivative import NoSlope, derivative
    from compiler.algebra.expression import (
        Apply,
        Expression,
        Number,
        Symbol,
        call,
        depends_on,
        evaluate,
        select,
        substitute,
        symbols,
    )  # fmt: skip
    from compiler.algebra.formula import Bound
    from compiler.algebra.operators import value_of
    from compiler.algebra.sympy_form import to_sympy
    from compiler.causality import Because, CausalGraph, Dependence, dependences
    from compiler.certificate import Certificate
    from compiler.chance import DISTRIBUTIONS, SPREAD, fault, kinds_told
    from compiler.codegen.cost import Cost, cost
    from compiler.codegen.limits import Leaf
    from compiler.codegen.llvm.bind import bind
    from compiler.codegen.llvm.described import Described
    from compiler.codegen.lowered import Lowered
    from compiler.codegen.program import EventNote, Function, Hybrid, LimitNote, Program, TimeFunctions
    from compiler.codegen.ranges import Ranges
    from compiler.codegen.series import Expansion, Series
    from compiler.codegen.tape import Tape
    from compiler.driver import Compilation, examine
    from compiler.driver import check as check_source
    from compiler.equations.sharing import dependent_rates
    from compiler.equations.system import Assignment, EquationSystem, PowerPort, Storage
    from compiler.errors import CompilationFailed, Diagnostic, InternalError, ValuesNeeded, render
    from compiler.graph.domains import BUNDLES, DOMAINS
    from compiler.graph.mechanism import Body, Joint, Mechanism, freedoms_of
    from compiler.graph.network import BondGraph, Element, Junction, Kind, MechanismNode, Quantity, Reading
    from compiler.graph.network import Node as GraphNode
    from compiler.graph.units import SECOND
    from compiler.graph.valves import Valve
    from compiler.memory import uncollected
    from compiler.native.arrays import Floats, Ints, Numbers, Record
    from compiler.native.kinds import INTS, Fields, Handed, record_of
    from compiler.native.machine import MachineCode, address_of, object_code, processor
    from compiler.native.machine import available as native_available
    from compiler.native.translate import translate
    from compiler.reduction.order import blocks
    from compiler.reduction.state_space import LinearLoop, StateSpace, Unknown
    from compiler.scene import (
        SOLVERS,
        Analysis,
        Differentiating,
        Drawn,
        Facts,
        Fitting,
        Following,
        Inverting,
        Linearizing,
        Override,
        Plan,
        Reported,
        Scene,
        Study,
        Varying,
    )
    from compiler.semantics.domain_table import ELEMENT_KINDS
    from compiler.semantics.errors import Unsupported
    from compiler.semantics.scales import scale_of
    from compiler.semantics.scope import RESERVED
    from compiler.semantics.unit import read_unit
    from compiler.semantics.within import project_folder
    from compiler.source import Source, Span, read_text
    from compiler.source_file import read_source
    from compiler.syntax import parse_expression, parse_law
    from compiler.syntax.format import format_text
    from compiler.syntax.tree import Experiment, Literal, Negative, Path
    from compiler.writing import write_text
    from compiler.writing.literals import bond_lines, braces, number_text

_HOMES = {
    "affine_parts": "algebra.affine", "derivative": "algebra.derivative", "Symbol": "algebra.expression", "depends_on": "algebra.expression",
    "PowerPort": "equations.system", "Element": "graph.network", "Junction": "graph.network", "Kind": "graph.network",
    "Body": "graph.mechanism",
    "Joint": "graph.mechanism",
    "Bound": "algebra.formula",
    "Number": "algebra.expression",
    "value_of": "algebra.operators",
    "BondGraph": "graph.network", "GraphNode": "graph.network:Node", "Quantity": "graph.network", "Reading": "graph.network",
    "Apply": "algebra.expression", "Expression": "algebra.expression", "symbols": "algebra.expression",
    "call": "algebra.expression", "select": "algebra.expression",
    "substitute": "algebra.expression",
    "Mechanism": "graph.mechanism", "freedoms_of": "graph.mechanism", "MechanismNode": "graph.network",
    "evaluate": "algebra.expression", "to_sympy": "algebra.sympy_form", "Program": "codegen.program", "Compilation": "driver", "check_source": "driver:check",
    "examine": "driver", "Certificate": "certificate", "Unknown": "reduction.state_space",
    "EventNote": "codegen.program", "Hybrid": "codegen.program", "Function": "codegen.program", "TimeFunctions": "codegen.program",
    "LimitNote": "codegen.program", "Assignment": "equations.system", "Storage": "equations.system", "CompilationFailed": "errors", "Diagnostic": "errors",
    "InternalError": "errors",
    "ValuesNeeded": "errors",
    "render": "errors",
    "SECOND": "graph.units",
    "Valve": "graph.valves",
    "Experiment": "syntax.tree",
    "LinearLoop": "reduction.state_space",
    "StateSpace": "reduction.state_space",
    "Override": "scene",
    "Plan": "scene",
    "Reported": "scene",
    "Scene": "scene",
    "SOLVERS": "scene",
    "Unsupported": "semantics.errors", "read_unit": "semantics.unit",
    "project_folder": "semantics.within", "scale_of": "semantics.scales", "Source": "source", "Span": "source",
    "read_source": "source_file",
    "read_text": "source",
    "uncollected": "memory", "parse_expression": "syntax", "format_text": "syntax.format", "Literal": "syntax.tree", "write_text": "writing",
    "BUNDLES": "graph.domains", "DOMAINS": "graph.domains", "ELEMENT_KINDS": "semantics.domain_table", "RESERVED": "semantics.scope",
    "Negative": "syntax.tree", "parse_law": "syntax", "Path": "syntax.tree", "bond_lines": "writing.literals", "braces": "writing.literals",
    "number_text": "writing.literals", "Because": "causality", "CausalGraph": "causality", "Dependence": "causality",
    "Described": "codegen.llvm.described", "bind": "codegen.llvm.bind", "Facts": "scene", "native_available": "native.machine:available",
    "processor": "native.machine",
    "Numbers": "native.arrays",
    "Floats": "native.arrays", "Ints": "native.arrays", "Record": "native.arrays", "MachineCode": "native.machine", "object_code": "native.machine",
    "address_of": "native.machine",
    "INTS": "native.kinds", "Handed": "native.kinds", "Fields": "native.kinds", "record_of": "native.kinds", "translate": "native.translate",
    "dependent_rates": "equations.sharing",
    "dependences": "causality", "Cost": "codegen.cost", "cost": "codegen.cost", "EquationSystem": "equations.system", "blocks": "reduction.order",
    "Leaf": "codegen.limits",
    "Ranges": "codegen.ranges", "Expansion": "codegen.series", "Series": "codegen.series", "Lowered": "codegen.lowered",
    "NoSlope": "algebra.derivative", "Tape": "codegen.tape", "Study": "scene",
    "Analysis": "scene", "Differentiating": "scene", "Drawn": "scene", "Fitting": "scene", "Following": "scene", "Inverting": "scene",
    "Linearizing": "scene", "Varying": "scene", "DISTRIBUTIONS": "chance", "SPREAD": "chance", "fault": "chance", "kinds_told": "chance",
}  # fmt: skip

__all__ = [
    "BUNDLES",
    "DISTRIBUTIONS",
    "DOMAINS",
    "ELEMENT_KINDS",
    "INTS",
    "RESERVED",
    "SECOND",
    "SOLVERS",
    "SPREAD",
    "Analysis",
    "Apply",
    "Assignment",
    "Because",
    "Body",
    "BondGraph",
    "Bound",
    "CausalGraph",
    "Certificate",
    "Compilation",
    "CompilationFailed",
    "Cost",
    "Dependence",
    "Described",
    "Diagnostic",
    "Differentiating",
    "Drawn",
    "Element",
    "EquationSystem",
    "EventNote",
    "Expansion",
    "Experiment",
    "Expression",
    "Facts",
    "Fields",
    "Fitting",
    "Floats",
    "Following",
    "Function",
    "GraphNode",
    "Handed",
    "Hybrid",
    "InternalError",
    "Ints",
    "Inverting",
    "Joint",
    "Junction",
    "Kind",
    "Leaf",
    "LimitNote",
    "LinearLoop",
    "Linearizing",
    "Literal",
    "Lowered",
    "MachineCode",
    "Mechanism",
    "MechanismNode",
    "Negative",
    "NoSlope",
    "Number",
    "Numbers",
    "Override",
    "Path",
    "Plan",
    "PowerPort",
    "Program",
    "Quantity",
    "Ranges",
    "Reading",
    "Record",
    "Reported",
    "Scene",
    "Series",
    "Source",
    "Span",
    "StateSpace",
    "Storage",
    "Study",
    "Symbol",
    "Tape",
    "TimeFunctions",
    "Unknown",
    "Unsupported",
    "ValuesNeeded",
    "Valve",
    "Varying",
    "address_of",
    "affine_parts",
    "bind",
    "blocks",
    "bond_lines",
    "braces",
    "call",
    "check_source",
    "cost",
    "dependences",
    "dependent_rates",
    "depends_on",
    "derivative",
    "evaluate",
    "examine",
    "fault",
    "format_text",
    "freedoms_of",
    "kinds_told",
    "native_available",
    "number_text",
    "object_code",
    "parse_expression",
    "parse_law",
    "processor",
    "project_folder",
    "read_source",
    "read_text",
    "read_unit",
    "record_of",
    "render",
    "scale_of",
    "select",
    "substitute",
    "symbols",
    "to_sympy",
    "translate",
    "uncollected",
    "value_of",
    "write_text",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'bondgraph.door' has no attribute {name!r}")
    module, _, attribute = home.partition(":")
    try:
        if not _opened:
            _open()
        return getattr(import_module(f"compiler.{module}"), attribute or name)
    except ModuleNotFoundError as error:
        raise _other_compiler(error) from error


_opened: list[bool] = []


def _open() -> None:
    """Give the compiler a cache for data that are equal for all texts."""
    from . import cache

    import_module("compiler.kept").keep_on(cache)
    _opened.append(True)


def _other_compiler(error: ModuleNotFoundError) -> ImportError:
    """Return the error for a file `compiler.py` beside the user's script, which hides our package."""
    import sys

    found = getattr(sys.modules.get("compiler"), "__file__", None)
    if found is None or not (error.name or "").startswith("compiler"):
        return error
    return ImportError(f"bondgraph needs its own package `compiler`, but Python found {found} first: rename that file")
