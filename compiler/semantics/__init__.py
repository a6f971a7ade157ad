"""Syntax tree to bond graph: names, imports, instances, units."""

from .build import Built, build_graph, check_parts, open_part

__all__ = ["Built", "build_graph", "check_parts", "open_part"]
