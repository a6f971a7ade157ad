"""Events that accumulate at a level away from zero: each return is found, however soon it comes, so a run ends with words.

A return within a hundredth of a step was once found late (the rounding at the start of the step hid it), and the motion then fell through the
stop, as no event made its condition false any more.
"""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph
from bondgraph.errors import RunFailed

TEXT = """plain model Stop {{
  C spring : e = {stiff}*q
  I mass : p = f {{ start p = 1 }}
  Se push : e = {push}
  push -> 1(spring, mass)
  when {condition} {{ mass.p = -{rebound}*mass.p }}
  output q = spring.q, p = mass.p
  experiment go {{ simulate 0 .. 6 }}
}}
"""
# Rebound, push, stiffness and level: the push holds the mass against the stop, so it comes to rest there in finite time.
STOPS = [
    (0.3, 0.3, 2, 0.03),
    (0.3, 1.7, 2, 0.03),
    (0.3, 30, 2, 0.5),
    (0.4, 2, 0, 0.001),
    (0.5, 0.3, 2, 0.03),
    (0.5, 1.7, 2, 0.03),
    (0.5, 5, 10, 0.2),
    (0.6, 4, 3, -0.01),
    (0.7, 1.7, 2, 0.03),
    (0.7, 9, 2, 1.3),
    (0.8, 30, 5, 0.11),
    (0.9, 30, 2, 0.03),
]


@pytest.mark.few(6)
@pytest.mark.machine_code
@pytest.mark.parametrize("condition", ["spring.q > {level}", "{level} < spring.q and mass.p > -1000"])
@pytest.mark.parametrize(("rebound", "push", "stiff", "level"), STOPS)
def test_bounces_that_end_nowhere_are_told(
    rebound: float, push: float, stiff: float, level: float, condition: str
) -> None:
    text = TEXT.format(rebound=rebound, push=push, stiff=stiff, condition=condition.format(level=level))
    model = bondgraph.load(text)
    for rtol, solver in ((1e-4, "automatic"), (1e-6, "automatic"), (1e-7, "explicit"), (1e-9, "automatic")):
        with pytest.raises(RunFailed, match="again and again in no time"):
            model.simulate(points=3, rtol=rtol, solver=solver)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize(("rebound", "push", "level"), [(0.3, 0.3, 0.03), (0.5, 1.7, 0.03), (0.7, 1.7, 0.25)])
def test_each_bounce_is_where_its_parabola_ends(rebound: float, push: float, level: float, target: str) -> None:
    """Without a spring the mass flies on parabolas, each `rebound` times as long as the one before; a run may end where one does."""
    text = TEXT.format(rebound=rebound, push=push, stiff=0, condition=f"spring.q > {level}")
    model, speed = bondgraph.load(text), np.sqrt(1 + 2 * push * level)
    exact = ((speed - 1) + 2 * speed * rebound * (1 - rebound ** np.arange(10)) / (1 - rebound)) / push
    for count in range(5, 10):
        for stop in (exact[count], 0.5 * (exact[count - 1] + exact[count])):
            found = model.simulate(to=stop, points=3, target=target)
            times = np.array([e.time for e in found.events])
            assert count <= len(times) <= count + 1
            np.testing.assert_allclose(times[:count], exact[:count], rtol=1e-12)


# ---------------------------------------------------------------------- events that set one of several tied storages

PARTS = {
    "Friction": """plain model Friction {
  parameter fc = 0.5, fs = 0.6
  port ends: untyped
  mode direction = 1
  0 end
  1 contact { active = direction != 0 }
  MR surface : e = direction*fc + 0.1*f
  ends -> end -> contact -> surface
  when direction == 0 and abs(end.e) > fs { direction = 1 if end.e > 0 else -1 }
  when direction*contact.f < 0 { direction = 0 }
}
""",
    "Valve": """plain model Valve {
  port ends: untyped
  mode open = true
  1 line
  0 gap { active = not open }
  ends -> line -> gap
  when not open and gap.e > 0 { open = true }
  when open and line.f < 0 { open = false }
}
""",
}
TIED = """plain model Tied {{
  1 j1
  1 j2
  j1 -> j2
  I a : p = 0.4*f {{ start p = 0.8 }}
  I b : p = 1.6*f {{ start p = 3.2 }}
  j1 -> a
  j2 -> b
  {part} part
  j2 -> part.ends
  Se push : e = {push}
  push -> j1
  when time > 0.4 {{ {chosen}.p = {factor}*{chosen}.p }}
  output pa = a.p, pb = b.p
  experiment go {{ simulate 0 .. 1 }}
}}
"""


@pytest.mark.few(16)
@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize("part", ["Friction", "Valve"])
@pytest.mark.parametrize("chosen", ["a", "b"])
@pytest.mark.parametrize("factor", [0.5, -0.7])
@pytest.mark.parametrize("push", [0.3, 0.9, -0.2])
def test_a_storage_that_shares_a_flow_takes_the_others_along(
    part: str, chosen: str, factor: float, push: float, target: str
) -> None:
    """Both storages keep one flow; a reversal closes the valve or makes the friction stick, and the push opens or frees it, or does not."""
    text = PARTS[part] + TIED.format(part=part, push=push, chosen=chosen, factor=factor)
    found = bondgraph.load(text).simulate(points=11, target=target)
    drag, limit = (0.5, 0.6) if part == "Friction" else (0.0, 0.0)

    def later(speed: float, time: float) -> float:
        if part == "Valve":
            return speed + push / 2 * time
        end = (push - drag) / 0.1
        return end + (speed - end) * np.exp(-0.05 * time)

    speed = max(factor * later(2.0, 0.4), 0.0)
    after = later(speed, 0.6) if speed > 0 or push > limit else 0.0
    np.testing.assert_allclose([found.final("pa"), found.final("pb")], [0.4 * after, 1.6 * after], atol=1e-6)


@pytest.mark.parametrize("target", [pytest.param("native", marks=pytest.mark.machine_code), "numpy"])
@pytest.mark.parametrize("last", [0.0075, 1e-4, 1e-7])
def test_crossings_near_each_other_by_chance_are_no_accumulation(last: float, target: str) -> None:
    """A level is reached four times, 0.86, 0.33 and `last` seconds apart, and then left behind for good."""
    text = f"""plain model Near {{
      C store : e = q
      mode n = 0, since = -10
      MSf feed : f = 1 if time - since > half else -1
      signal half = 0.43 if n < 1.5 else 0.165 if n < 2.5 else {last / 2!r} if n < 3.5 else -1
      feed -> 0(store)
      when store.q > 0.5 {{ n = n + 1; since = time }}
      output q = store.q, count = n
      experiment go {{ simulate 0 .. 3 }}
    }}"""
    result = bondgraph.load(text).simulate(points=3, target=target)
    assert result.final("count") == 4
    assert result.final("q") == pytest.approx(0.5 + 3 - (0.5 + 0.86 + 0.33 + last), rel=1e-9)
