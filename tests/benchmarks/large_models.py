"""Large models as text: ladders flat and as arrays, a mesh, a star, a random network. Storages leak, linearly or as the cube of their content."""

from __future__ import annotations

import math
import random

CUBIC = "{c} [A/V]*u + {d} [A/V^3]*u^3"
LINEAR = "{c} [A/V]*u"
SPAN = "1 ms"  # long beside one section's time constant, short beside that of a long ladder


def rc_ladder(sections: int, leak: str = CUBIC) -> str:
    """Resistors in a row between capacitors that leak to the ground, one after another as flat text."""
    law = leak.format(c="1e-4", d="1e-3")
    parts = [
        "model Ladder {\n  Se source : u = 1 V*sin(2*pi*1000 [1/s]*time)\n  0 node_0 : electric\n  source -> node_0\n"
    ]
    for i in range(1, sections + 1):
        parts.append(
            f"  R wire_{i} : u = 10 ohm*i\n  C plates_{i} : q = 1 uF*u  {{ start u = {start(i)} V }}\n  R leak_{i} : i = {law}\n"
            f"  0 node_{i} : electric\n  node_{i - 1} -> 1(wire_{i}) -> node_{i} -> plates_{i}, leak_{i}\n"
        )
    return "".join(parts) + _end(f"node_{1 + sections // 10}.u", f"node_{sections}.u")


def rc_ladder_array(sections: int, leak: str = CUBIC) -> str:
    """The same with one section as a model of its own, in an array."""
    law = leak.format(c="1e-4", d="1e-3")
    return f"""model Section {{
  parameter begin: V
  port left: electric, right: electric
  R wire   : u = 10 ohm*i
  C plates : q = 1 uF*u  {{ start u = begin }}
  R leak   : i = {law}
  0 node
  left -> 1(wire) -> node -> plates, leak
  node -> right
}}

model Ladder {{
  Se source : u = 1 V*sin(2*pi*1000 [1/s]*time)
  for i in 1..{sections} {{ Section part[i] {{ begin = (0.5 + 0.4*sin(i))*1 [V] }} }}
  source -> part[1].left
  for i in 1..{sections} - 1 {{ part[i].right -> part[i+1].left }}
  Sf end : i = 0
  part[{sections}].right -> end
{_end(f"part[{1 + sections // 10}].node.u", f"part[{sections}].node.u")}"""


def lc_ladder(sections: int, leak: str = CUBIC) -> str:
    """Coils in a row between capacitors that leak."""
    law = leak.format(c="1e-4", d="1e-3")
    parts = [
        "model Ladder {\n  Se source : u = 1 V*sin(2*pi*1000 [1/s]*time)\n  0 node_0 : electric\n  source -> node_0\n"
    ]
    for i in range(1, sections + 1):
        parts.append(
            f"  I coil_{i} : lambda = 1 mH*i\n  R wire_{i} : u = 5 ohm*i\n  C plates_{i} : q = 1 uF*u  {{ start u = {start(i)} V }}\n  R leak_{i} : i = {law}\n"
            f"  0 node_{i} : electric\n  node_{i - 1} -> 1(coil_{i}, wire_{i}) -> node_{i} -> plates_{i}, leak_{i}\n"
        )
    return "".join(parts) + _end(f"node_{1 + sections // 10}.u", f"node_{sections}.u")


def network(edges: list[tuple[int, int]], nodes: int, leak: str = CUBIC, name: str = "Network") -> str:
    """Capacitors that leak at all nodes, resistors along the edges; node 1 is fed."""
    law = leak.format(c="1e-4", d="1e-3")
    parts = [f"model {name} {{\n  Se source : u = 1 V*sin(2*pi*1000 [1/s]*time)\n"]
    for i in range(1, nodes + 1):
        parts.append(
            f"  C plates_{i} : q = 1 uF*u  {{ start u = {start(i)} V }}\n  R leak_{i} : i = {law}\n  0 node_{i} : electric\n  node_{i} -> plates_{i}, leak_{i}\n"
        )
    parts.append("  R feed : u = 10 ohm*i\n  source -> 1(feed) -> node_1\n")
    for k, (a, b) in enumerate(edges, 1):
        parts.append(f"  R wire_{k} : u = {10 + k % 7} ohm*i\n  node_{a} -> 1(wire_{k}) -> node_{b}\n")
    return "".join(parts) + _end("node_2.u", f"node_{nodes}.u")


def mesh_edges(side: int) -> list[tuple[int, int]]:
    """The edges of a square mesh, nodes numbered by rows from 1."""
    across = [(side * i + j, side * i + j + 1) for i in range(side) for j in range(1, side)]
    return across + [(side * i + j, side * (i + 1) + j) for i in range(side - 1) for j in range(1, side + 1)]


def star_edges(degree: int) -> list[tuple[int, int]]:
    """All nodes from 2 on hang on node 1."""
    return [(1, i) for i in range(2, degree + 2)]


def random_edges(nodes: int, more: int, seed: int = 1) -> list[tuple[int, int]]:
    """A random tree with some more edges: each node joins an earlier one, among the last fifty or any."""
    draw = random.Random(seed)
    tree = [(draw.randint(max(1, i - 50), i - 1), i) for i in range(2, nodes + 1)]
    others = [tuple(sorted(draw.sample(range(1, nodes + 1), 2))) for _ in range(more)]
    return tree + [(a, b) for a, b in others]


def start(i: int) -> str:
    """The voltage at which node i begins."""
    return f"{0.5 + 0.4 * math.sin(i):.6f}"


def _end(first: str, last: str) -> str:
    return (
        f"  output first = {first}, last = {last}\n  experiment go {{ simulate 0 .. {SPAN}; report first, last }}\n}}\n"
    )
