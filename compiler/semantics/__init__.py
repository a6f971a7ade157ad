"""Syntax tree to bond graph: names, imports, instances, units."""

from .build import Built, build_graph, check_parts, open_part
from .resolution.elaboration_cache import MAXIMUM_PARTS

__all__ = ["MAXIMUM_PARTS", "Built", "build_graph", "check_parts", "open_part"]
