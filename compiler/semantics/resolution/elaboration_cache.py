"""Cache for the elaboration of the models of one file."""

from __future__ import annotations

from dataclasses import field

from ...fast_dataclass import dataclass
from ...graph.network import Law
from ...graph.units import Scale
from ...syntax import tree
from ..expressions.template import CompiledLaw, Template
from ..names.port_domains import DomainTable

MAXIMUM_PARTS = 100_000  # instances, elements, junctions, quantities and rounds of loops together


@dataclass(slots=True)
class ElaborationCache:
    """Results that are the same for every model of a file: compiled places of the text, domain tables, laws.

    Keys are identities of nodes and definitions; this object or the file keeps them alive. A place that reads lists has one
    entry for each set of their lengths.
    """

    most_parts: int = MAXIMUM_PARTS
    templates: dict[tuple[int, Scale | None], list[Template]] = field(default_factory=dict)
    tables: dict[int, DomainTable] = field(default_factory=dict)
    laws: dict[int, list[CompiledLaw]] = field(default_factory=dict)  # by declaration: compiled once per definition
    interned: dict[Law, Law] = field(default_factory=dict)  # equal laws of flat text are one law
    nodes: list[tree.ExpressionSyntax] = field(default_factory=list)
