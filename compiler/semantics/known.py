"""What need not be found twice while the models of one file are opened."""

from __future__ import annotations

from dataclasses import field

from ..graph.network import Law
from ..graph.units import Scale
from ..nouns import dataclass
from ..syntax import tree
from .domain_table import DomainTable
from .laws import CompiledLaw
from .template import Template


@dataclass(slots=True)
class Known:
    """What is the same whichever model of a file is opened: places of the text compiled, domains spread.

    Keys are identities of nodes and definitions, which are kept here or by the file. Of a place that reads lists there is one
    entry for each set of their lengths.
    """

    templates: dict[tuple[int, Scale | None], list[Template]] = field(default_factory=dict)
    tables: dict[int, DomainTable] = field(default_factory=dict)
    laws: dict[int, list[CompiledLaw]] = field(default_factory=dict)  # by declaration: compiled once per definition
    interned: dict[Law, Law] = field(default_factory=dict)  # equal laws of flat text are one law
    nodes: list[tree.Expression] = field(default_factory=list)
