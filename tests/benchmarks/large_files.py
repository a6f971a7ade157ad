"""Large files as somebody might write them or have them written: a ladder without submodels, and lines of submodels in arrays."""

from __future__ import annotations

SECTION = """  # section {i}
  parameter r_{i}: ohm = 0.{digit}, l_{i}: mH = {digit}   "winding of section {i}"
  R wire_{i}   : u = r_{i}*i
  I coil_{i}   : lambda = l_{i}*i
  C plates_{i} : q = {digit} uF*u     {{ start u = {digit} mV }}
  0 node_{i} : electric
  node_{before} -> 1(wire_{i}, coil_{i}) -> node_{i} -> plates_{i}
"""

LINE = """# ------------------------------------------------------------
# Line {i}: four cells between a wall and a mass that is pushed.
model Cell_{i} {{
  "One cell of line {i}."
  port left: translation, right: translation
  parameter k: N/m = {digit}00, k3: N/m^3 = 2e4, r: N*s/m = 0.{digit}      "stiffness, hardening, loss"
  C spring : F = k*x + k3*x^3      {{ start x = {digit} um }}
  R damper : F = r*v
  0 here
  left -> here -> right           # what the cell passes on
  here -> 1(spring, damper)
}}

model Line_{i} {{
  port end: translation
  parameter n = 4, m = {digit} g, gap: um = (1.{digit}, 2.5, 3)
  for j in 1..n {{ Cell_{i} cell[j] {{ k = (100 + 2*j)*1 [N/m] }} }}
  for j in 1..n {{
    1 body[j] : translation
    I mass[j] : p = m*v
    body[j] -> mass[j]
  }}
  for j in 1..n {{ body[j] -> cell[j].left }}
  for j in 1..n - 1 {{ cell[j].right -> body[j+1] }}
  R sink : F = 0.5 [N*s/m]*v
  end -> body[1]
  cell[n].right -> sink
  signal strain = bent(cell[1].spring.x/gap[1], 3)
  output strain_{i} = strain + 0*mass[n].v/1 [m/s]
}}

"""


def ladder(size: int) -> str:
    """A ladder of windings and plates in one model, of about `size` characters."""
    head = "model Ladder {\n  parameter u_0 = 5 V, r_load = 50 ohm\n  Se source : u = u_0*step(time - 1 ms)\n"
    parts = [head, "  source -> node_0\n  0 node_0 : electric\n"]
    length, i = len(head) + 300, 0
    while length < size or i == 0:
        i += 1
        parts.append(SECTION.format(i=i, before=i - 1, digit=1 + i % 9))
        length += len(parts[-1])
    parts.append(f"  R load : u = r_load*i\n  node_{i} -> load\n  output u = load.u, i = source.i\n")
    parts.append("  experiment go { simulate 0 .. 10 ms; report u in mV }\n}\n")
    return "".join(parts)


def lines(size: int) -> str:
    """Models with arrays and comments, each used once by the last one, of about `size` characters."""
    parts = ['"Lines of several kinds."\n\nfunction bent(x, limit) = limit*tanh(x/limit)\n\n']
    length, i = 200, 0
    while length < size or i == 0:
        i += 1
        parts.append(LINE.format(i=i, digit=1 + i % 9))
        length += len(parts[-1]) + 110
    parts.append("model Everything {\n")
    for k in range(1, i + 1):
        parts.append(f"  Se push_{k} : F = {1 + k % 5} mN*sin(2*pi*50 [1/s]*time)\n")
        parts.append(f"  Line_{k} line_{k}\n  push_{k} -> line_{k}.end\n")
    parts.append("  output x = line_1.cell[1].spring.x\n}\n")
    return "".join(parts)


KINDS = {"ladder": ladder, "lines": lines}
