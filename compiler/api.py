"""Names of the compiler that others may use: the imports below, each carried out when its name is first read.

Type checkers read the list as it stands. At run time `__getattr__` looks names up in the same lines, so that no unnecessary stage is loaded.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .persistent_cache import keep_on

if TYPE_CHECKING:
    from .algebra.affine import affine_parts
    from .algebra.derivative import NotDifferentiable, derivative
    from .algebra.expression import (
        Apply, Expression, Number, Symbol, call, depends_on, evaluate, operations, select, substitute, symbols,
    )  # fmt: skip
    from .algebra.formula import Bound
    from .algebra.intervals import interval_of
    from .algebra.interpolate import random_number
    from .algebra.operators import value_of
    from .algebra.sympy_form import to_sympy
    from .arrays import Array, BoolArray, ComplexArray, IntArray
    from .causality import CausalGraph, Dependence, StrokeReason, assign_causality, dependences
    from .causality.assign import demands as demanded_strokes
    from .causality.strokes import Contradiction, Stroke, StrokeOrigin, Strokes
    from .certificate import Certificate
    from .chance import DISTRIBUTIONS, SPREAD, Distribution, fault, kinds_told
    from .codegen.c.write import ARGUMENTS as C_ARGUMENTS
    from .codegen.c.stepping import c_fields
    from .codegen.c.write import c_string, write_library_c
    from .codegen.c.write import in_single_precision
    from .codegen.cost import Cost, cost
    from .codegen.zero_divisors import zero_divisors
    from .codegen.limits import Leaf
    from .codegen.numpy.generate import load_module
    from .codegen.llvm.evaluate import bind
    from .codegen.llvm.generate import LibraryModule, library_module
    from .codegen.errors import NotInUnit
    from .codegen.lower import lower
    from .codegen.lowered import Lowered
    from .codegen.program import EventNote, Hybrid, LimitNote, Program, SettingNote, TimeFunction, TimeFunctions
    from .codegen.ranges import Ranges
    from .codegen.rounding import rounding_of
    from .codegen.series import TaylorSeries
    from .codegen.structure import CHANGING, ProgramStructure, structure_of
    from .codegen.tape import Tape
    from .codegen.text.targets import target_of, text_targets
    from .codegen.time_functions import narrow_conditions
    from .compilation import Compilation
    from .examination import examine
    from .examination import check as check_source
    from .equations import derive_equations
    from .equations.sharing import dependent_rates
    from .equations.system import Assignment, EquationSystem, EventRow, PowerPort, Storage, Variable
    from .errors import CompilationFailed, Diagnostic, InternalError, ValuesNeeded, printable, render
    from .graph.domains import BUNDLES, DOMAINS, Domain
    from .graph.elements import ELEMENTS, Kind, letters
    from .graph.mechanism import Body, Joint, Mechanism, freedoms_of
    from .graph.network import BondEnd, BondGraph, Element, Junction, MechanismNode, Named, Quantity, Reading
    from .graph.network import Node as GraphNode
    from .graph.prune import adjustable, derivative_wishes, preferring
    from .graph.units import PREFIXES, UNITS, Dimension, Scale
    from .linking.elf_library import check_length
    from .linking.layout import SharedLibrary
    from .linking.link import link
    from .linking.object_file import LinkError
    from .metamorphosis.reductions import smallest
    from .metamorphosis.text_changes import TEXT_CHANGES, Inapplicable, TextChange, TextScene, scene_of
    from .persistent_cache import CacheBackend
    from .project import EditedFile, Project, FileSurvey
    from .fast_dataclass import dataclass
    from .garbage_collection import uncollected
    from .jit.arrays import Bytes, Floats, Ints, Numbers, Record, ShortInts, sized
    from .jit.c_source import c_source, small_functions
    from .jit.kinds import FLOATS, INTS, Fields, Handed, record_of, zeros_of
    from .jit.machine import PLATFORMS as LIBRARY_PLATFORMS
    from .jit.machine import MachineCode, address_of, object_code, processor
    from .jit.machine import available as native_available
    from .jit.translate import translate
    from .jit.values import Choices
    from .jit.vectorise import Vectorised
    from .reduction.order import blocks
    from .reduction.state_space import LinearLoop, StateSpace
    from .reduction.structures import NotJoined
    from .scene import (
        Analysis, BoundedParameter, Differentiating, Fitting, Inverting, Linearizing, MonteCarloRequest, Override, Plan,
        Reported, RunMetadata, Scene, Study, full_name,
    )  # fmt: skip
    from .semantics import MAXIMUM_PARTS
    from .semantics.expressions.expression_compiler import MEMORIES
    from .semantics.expressions.functions import FUNCTIONS
    from .semantics.expressions.scales import counts_radians, scale_of
    from .semantics.expressions.tables import USAGE as TABLE_USAGES
    from .semantics.expressions.scales import read_unit, readings
    from .semantics.expressions.vectors import VECTORS
    from .semantics.names.declared_names import (
        DeclaredName,
        NameTable,
        file_names,
        first_text,
        name_span,
        parts_of,
        path_of,
        table_of,
    )
    from .semantics.names.domain_table import ELEMENT_KINDS
    from .semantics.names.name_uses import NameUse, model_of, name_uses, names_inside
    from .semantics.names.part_kinds import attributes_of, kinds_of
    from .semantics.names.scope import RESERVED, ElementEntry, FileScope, PartEntry
    from .semantics.names.imports import project_folder
    from .semantics.names.unit_file import (
        HELD,
        NewNames,
        UnitDescription,
        UnitVariable,
        open_unit,
        read_unit_description,
    )
    from .solvers import AUTOMATIC, SOLVERS, Solver
    from .source import SYSTEM, UNIT, Source, Span, read_text
    from .source_file import read_source
    from .steps import ANALYSIS_STEPS
    from .syntax import parse, parse_expression, parse_law, tree
    from .syntax.blocks import nodes_in
    from .syntax.format import format_text
    from .syntax.outline import Outline
    from .syntax.tree import (
        Bonds, Call, Description, Experiment, Literal, ModelSyntax, Negative, PathSyntax, PortsSyntax, Quantities, RequirementSyntax,
    )  # fmt: skip
    from .syntax.words import grammar_words
    from .unparse import write_text
    from .unparse.literals import bond_lines, braces, number_text


@cache
def _imports() -> dict[str, tuple[str, str]]:
    """Module and original name of each import of this file from the compiler, by the name that it has here."""
    import ast
    from pathlib import Path

    statements = ast.walk(ast.parse(Path(__file__).read_text(encoding="utf-8")))
    lines = [s for s in statements if isinstance(s, ast.ImportFrom) and s.level == 1]
    return {a.asname or a.name: (f".{line.module}", a.name) for line in lines for a in line.names}


def __getattr__(name: str) -> Any:
    if name not in _imports():
        raise AttributeError(f"module 'compiler.api' has no attribute {name!r}")
    module, original = _imports()[name]
    return globals().setdefault(name, getattr(import_module(module, __package__), original))


def __dir__() -> list[str]:
    return sorted(_imports())
