"""ngspice on the transistor amplifier. Its time is that of the analysis, as ngspice reports it. It solves the same circuit, not the same text."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.peers import Done, Run
from tests.benchmarks.scenes import POINTS, Scene

NETLIST = """* the transistor amplifier
Vs in 0 sin(0 0.1 100)
Vb ub 0 6
R0 in n1 1000
C1 n1 n2 1u
R1 n2 0 9000
R2 ub n2 9000
B1 n2 n3 I=1e-6*(exp(V(n2,n3)/0.026)-1)
B2 n4 n2 I=0.99e-6*(exp(V(n2,n3)/0.026)-1)
C2 n3 0 2u
R3 n3 0 9000
R4 ub n4 9000
C3 n4 n5 3u
R5 n5 0 9000
R6 ub n5 9000
B3 n5 n6 I=1e-6*(exp(V(n5,n6)/0.026)-1)
B4 n7 n5 I=0.99e-6*(exp(V(n5,n6)/0.026)-1)
C4 n6 0 4u
R7 n6 0 9000
R8 ub n7 9000
C5 n7 n8 5u
R9 n8 0 9000
.ic v(n1)=0 v(n2)=3 v(n3)=3 v(n4)=6 v(n5)=3 v(n6)=3 v(n7)=6 v(n8)=0
.options reltol={reltol} abstol={abstol} vntol={vntol} chgtol=1e-20 trtol=1 method={method}
.control
tran {step} {stop} 0 {step} uic
rusage trantime
linearize v(n1) v(n2) v(n3) v(n4) v(n5) v(n6) v(n7) v(n8)
set wr_singlescale
set numdgt=15
wrdata {out} v(n1) v(n2) v(n3) v(n4) v(n5) v(n6) v(n7) v(n8)
quit
.endc
.end
"""


def there() -> bool:
    return shutil.which("ngspice") is not None


def run(scene: Scene, magnitude: Any) -> Run | None:
    """The trapezoidal rule, or Gear's method; `linearize` takes values between its steps."""
    if scene.name != "amplifier" or not there():
        return None

    def once(rtol: float) -> Done:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            step = scene.stop / (POINTS - 1)
            text = NETLIST.format(
                reltol=rtol,
                abstol=1e-6 * rtol,
                vntol=rtol,
                method="trap",
                step=step,
                stop=scene.stop,
                out=folder / "out",
            )
            (folder / "amplifier.cir").write_text(text)
            done = subprocess.run(
                ["ngspice", "-b", "amplifier.cir"], cwd=folder, capture_output=True, text=True, timeout=60
            )
            told = re.search(
                r"transient time\s*=\s*([0-9.eE+-]+)|tran(?:sient)?[^=\n]*=\s*([0-9.eE+-]+)", done.stdout, re.IGNORECASE
            )
            found = next((p for p in folder.glob("out*")), None)
            if found is None or told is None:
                raise RuntimeError(done.stdout[-300:] + done.stderr[-300:])
            table = np.loadtxt(found)
            values = table[:, 1:]
            if len(values) != POINTS:
                values = np.stack([np.interp(scene.instants, table[:, 0], v) for v in values.T], axis=-1)
            return Done(values, float(next(g for g in told.groups() if g)))

    return once
