"""6. Laws that fail: NaN at a random time, an exception, a stall, each reported in the right words; unrequested outputs stop nothing."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import bondgraph
from bondgraph.errors import RunBroken, RunFailed, UsageError
from tests.stress.report import Section
from tests.stress.trial import TooLong, shortened, within
from tests.stress.ways import Way, loaded, ways

TEXT = """model Faulty {{
  parameter late = 1 s
  I mass : p = 1 kg*v        {{ start v = 1 [m/s] }}
  C spring : F = 4 [N/m]*x + 1 [N/m^3]*x^3
  R drag : F = 0.1 [N*s/m]*v
  {kind} push : F = {law}
  push -> 1(mass, spring, drag)
  output x = spring.x
{more}}}
"""


@dataclass(frozen=True, slots=True)
class Fault:
    """A law that fails. `told` must match the message, which must name the time to within `near` (relative)."""

    name: str
    law: str
    told: str
    near: float = 0.05
    more: str = ""
    when: float | None = None  # where it does not follow the parameter


FAULTS = (
    Fault("root of a negative", "1 N*sqrt((late - time)/1 s)", r"sqrt|root"),
    Fault("logarithm of nothing", "1 N*log((late - time)/1 s)", r"log"),
    Fault("division by zero at an instant", "1 N/(1 if time < late else 0)", r"zero|not finite|infinite"),
    Fault("no number from an instant on", "1 N*(0 if time < late else sqrt(-1 - spring.x^2/1 [m^2]))", r"sqrt|root"),
    Fault("arc sine beyond one", "1 N*asin(0.5 + time/(2*late))", r"asin"),
    Fault("overflow", "1e-300 [N/s]*grown", r"exp|not finite|large", near=0.1, more="  signal grown = integral(exp(709*(time/late)^8), 0 s)\n"),
    Fault("growth without bound", "1 [N/m]*grown", r"grows without bound|cannot hold|not finite|gets no further", more="  signal grown = integral(grown^2*1 [1/m/s], 1 m)\n", when=1.0),
    Fault("a table left", "linear(spring.x + time*10 [m/s], (-5 m, 0 m, 5 m), (-5 N, 0 N, 5 N))", r"table|outside", near=1.0, when=0.45),
    Fault("root of a state", "1 N*sqrt(spring.x/1 m + 0.2)", r"square root", when=None, near=99.0),
)  # fmt: skip


# For a solver that takes linear models only, and for one that takes lossless ones.
OF_TIME = (
    *(f for f in FAULTS if f.name.startswith(("division", "logarithm", "arc"))),
    Fault("root of a negative from an instant on", "1 N*(0 if time < late else sqrt((late - time)/1 s - 1))", "root"),
)
LINEAR = (" + 1 [N/m^3]*x^3", "")
LOSSLESS = """model Lossless {
  parameter late = 1 s
  "A spring that has no energy beyond 1 m, where the mass is thrown to."
  I mass : p = 1 kg*v        { start v = 2 [m/s] }
  C spring : energy = 1 J*(1 - sqrt(1 - (x/1 m)^2))
  1(mass) -> spring
  output x = spring.x
}
"""
BEYOND = Fault("root of a state of a lossless model", LOSSLESS, r"root", near=99.0)


def faults_of(way: Way) -> tuple[Fault, ...]:
    """The faults that a solver can meet in the models that it takes."""
    return {"exponential": OF_TIME, "energy": (BEYOND,)}.get(way.solver, FAULTS)


def text_of(fault: Fault, way: Way) -> str:
    """The model in which it meets it."""
    if way.solver == "energy":
        return fault.law
    text = faulty(fault.law, fault.more)
    return text.replace(*LINEAR) if way.solver == "exponential" else text


def harmless(way: Way) -> str:
    """A model without a fault for a solver."""
    if way.solver == "energy":
        return LOSSLESS.replace("start v = 2", "start v = 0.5")
    return faulty("0 N").replace(*LINEAR) if way.solver == "exponential" else faulty("0 N")


def faulty(law: str, more: str = "") -> str:
    """The model with a law for its source."""
    kind = "MSe" if any(word in law for word in ("spring", "mass", "grown")) else "Se"
    return TEXT.format(law=law, more=more, kind=kind)


def section(short: bool) -> Section:
    """Faults in laws, in programs and in outputs, in every way."""
    found = Section("6. Faults")
    rows: list[list[Any]] = []
    chosen = ways()
    times = (0.7310585,) if short else (0.0123, 0.7310585, 2.5, 4.9)
    for way in chosen[:1] if short else chosen:
        for fault in faults_of(way):
            for when in times if "late" in fault.law + fault.more else times[:1]:
                rows.append(_law(found, fault, when, way))
        _unasked(found, way)
        _stall(found, way)
    found.table(("fault", "at, s", "way", "ends at, s", "told"), rows)
    for way in ways(("numpy",))[: 1 if short else None]:
        _exception(found, way)
    return found


def _law(found: Section, fault: Fault, when: float, way: Way) -> list[Any]:
    """One fault at one instant: it must be reported, with time and place."""
    found.tried += 1
    where = f"{fault.name} at {when:g} s ({way.name})"
    text = text_of(fault, way)
    try:
        with within(60.0):
            loaded(text).simulate(None, {"late": when}, to=5.0, points=101, **way.arguments)
    except RunFailed as failed:
        message = str(failed)
        match = re.search(r"t = ([-\d.e+]+) s", message)
        time = float(match.group(1)) if match else float("nan")
        expected = fault.when if fault.when is not None else when
        if not re.search(fault.told, message):
            found.fail(where, f"the message does not say what it is: {message}")
        elif not abs(time - expected) <= fault.near * max(expected, 0.1):
            found.fail(where, f"told at {time:g} s: {message}")
        # What has no energy is found by a look ahead, before the first of its equal steps.
        elif way.solver != "energy" and _kept(failed) is not None and not _kept_fits(failed, time):
            found.fail(where, "what was kept does not end where the run ended")
        return [fault.name, when, way.name, time, message[:160]]
    except TooLong:
        found.fail(where, "no end within 60 s")
    except Exception as error:
        found.fail(where, f"{type(error).__name__}: {error}")
    else:
        found.fail(where, "the run ended well")
    return [fault.name, when, way.name, "", ""]


def _kept(failed: RunFailed) -> bondgraph.Result | None:
    """The results up to a failure, where a run hands them on."""
    kept = getattr(failed, "result", None) or getattr(failed, "partial", None)
    return kept if isinstance(kept, bondgraph.Result) else None


def _kept_fits(failed: RunFailed, time: float) -> bool:
    """Return True if the kept results are finite and end at the last accepted instant before the failure (0.15 s before it at most)."""
    kept = _kept(failed)
    assert kept is not None
    return bool(
        np.isfinite(kept.values).all()
        and len(kept.time)
        and kept.time[-1] <= time + 1e-9
        and kept.time[-1] >= time - 0.15
    )


def _unasked(found: Section, way: Way) -> None:
    """An output without value that is not requested stops nothing; requested, it is reported."""
    text = harmless(way).removesuffix("}\n") + (
        "  output bad = sqrt(-1 - spring.x^2/1 [m^2]), odd = log(-1 - abs(mass.v)/1 [m/s])\n}\n"
    )
    found.tried += 2
    try:
        result = loaded(text).simulate(None, to=1.0, points=11, outputs=("x",), **way.arguments)
        if not np.isfinite(result["x"]).all():
            found.fail(f"an output that nobody requested ({way.name})", "the others are no numbers")
    except Exception as error:
        found.fail(f"an output that nobody requested ({way.name})", f"{type(error).__name__}: {error}")
    try:
        loaded(text).simulate(None, to=1.0, points=11, outputs=("x", "bad"), **way.arguments)
        found.fail(f"an output without a number ({way.name})", "nothing was told")
    except RunFailed as failed:
        if "bad" not in str(failed):
            found.fail(f"an output without a number ({way.name})", f"told without its name: {failed}")


def _stall(found: Section, way: Way) -> None:
    """A fast undamped oscillation needs more steps than allowed, which is reported; or the run is interrupted."""
    found.tried += 1
    text = """model Ringing {
  I mass : p = 1e-18 kg*v   { start v = 1 [m/s] }
  C spring : F = 1e18 [N/m]*x + 1e60 [N/m^3]*x^3
  1(mass) -> spring
  output x = spring.x
}
"""
    try:
        with within(3.0):
            loaded(text).simulate(None, to=1e3, points=11, **way.arguments)
        found.fail(f"a stall ({way.name})", "the run ended well")
    except RunFailed as failed:
        if "spring.x" not in str(failed) and "mass.p" not in str(failed):
            found.fail(f"a stall ({way.name})", f"told without a name: {failed}")
    except UsageError as failed:
        if way.chooses:
            raise
        found.unsuited[shortened(str(failed))] += 1
    except TooLong:
        pass  # it could be interrupted, and would have been told after some more steps


def _exception(found: Section, way: Way) -> None:
    """An exception within a program of numpy: it must come out, and not be taken for a step that is too long."""
    found.tried += 1
    where = f"an exception in a program ({way.name})"

    class Broken(Exception):
        pass

    model = bondgraph.load(harmless(way))
    model.simulate(None, to=1e-3, **way.arguments)
    for compiled_scene in model._prepared.values():
        program = compiled_scene.program

        def wrong(time: Any, *rest: Any, right: Any = program.derivative) -> Any:
            if np.max(time) > 0.5:
                raise Broken(f"at {time}")
            return right(time, *rest)

        compiled_scene.__dict__["program"] = replace(program, derivative=wrong)
    try:
        with within(60.0):
            model.simulate(None, to=1.0, **way.arguments)
        found.fail(where, "the run ended well")
    except RunBroken as broken:
        if not isinstance(broken.__cause__, Broken):
            found.fail(where, f"came out as {broken.__cause__!r}")
    except Exception as error:
        found.fail(where, f"{type(error).__name__}: {error}")
