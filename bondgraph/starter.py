"""First file of a new user: a model that runs, with a dozen comments that explain how to read it."""

from __future__ import annotations

import re

from compiler.api import ELEMENT_KINDS

_TEXT = """\
# A bond graph as text. Run it:  bondgraph run FILE --plot FILE.png   What is wrong with it:  bondgraph check FILE

model {name} {{
  "A mass on a spring with a damper, pushed."
  parameter m = 1 kg, k: N/m = 100                   # a number with its unit; or the unit after a colon
  parameter r: N*s/m = 2                             # `bondgraph run FILE --set "r=5 [N*s/m]"` changes it for one run
  input push = 0 N                                   # a signal from outside, here set by the experiment below

  # Elements: a letter, a name, a law in the element's own variables (F and v, x or p, as here; e f q p anywhere).
  MSe drive  : F = push                              # a source of effort; M, as its law reads a signal
  1   body                                           # a junction: all that is bonded to it has one velocity
  I   mass   : p = m*v                               # stores kinetic energy
  C   spring : F = k*x   {{ start x = 1 cm }}          # stores potential energy; 1 cm out at the start
  R   damper : F = r*v                               # dissipates

  # Bonds: an arrow is the positive direction of power, into what stores and dissipates.
  drive -> body -> mass, spring, damper

  output position = spring.x, speed = body.v         # what a run reports

  experiment pushed {{
    "Let go at 1 cm, pushed with 2 N from 3 s on."
    set push = 2 N*step(time - 3 s)
    simulate 0 .. 6 s
    report position in mm, speed in mm/s
  }}
}}
"""


def starter_text(name: str) -> str:
    """Return a first model, for `bondgraph new NAME`: it checks without an error, runs, and is formatted.

    The model is named after `name`, the stem of the file: `mass-spring 2` becomes `MassSpring2`. Characters that a name cannot have are omitted; if
    nothing remains, the model is called `First`.
    """
    words = re.findall(r"[A-Za-z0-9]+", name)
    model = "".join(word[0].upper() + word[1:] for word in words) or "First"
    if model[0].isdigit() or model in ELEMENT_KINDS:
        model = "Model" + model
    return _TEXT.format(name=model[:60])
