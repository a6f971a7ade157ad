"""Equal work is code once: functions over kernels compute what straight-line functions compute, and do not grow with the model."""

from __future__ import annotations

import re

import numpy as np
import pytest

from compiler.codegen import loop_rolling
from compiler.codegen.c.write import write_c
from compiler.codegen.llvm.evaluate import bind
from compiler.codegen.llvm.generate import generate_code
from compiler.codegen.program import Program
from compiler.codegen.program_image import ProgramImage
from compiler.compilation import Compilation
from compiler.jit.machine import object_code
from tests.benchmarks import large_models
from tests.codegen.test_banded import row_of_resistors
from tests.compiling import MODELS, compiled

FUNCTIONS = (
    "derivative", "jacobian_entries", "output", "powers", "claims", "forced", "dependent", "sensitivities", "holds", "limit_values",
    "invariant", "invariant_slopes",
)  # fmt: skip
MANY = (
    "active_filter", "chain", "crank_linkage", "drag", "four_bar", "manipulator", "plates", "rectifier", "robot_arm", "solenoid",
    "spatial_slider_crank", "sweep", "transformer",
)  # fmt: skip


def by_lines_and_by_kernels(made: Compilation, monkeypatch: pytest.MonkeyPatch) -> list[Program]:
    programs = []
    for longest, saving in ((10**9, 2), (-1, 0)):
        monkeypatch.setattr(loop_rolling, "LONGEST_IN_LINES", longest)
        monkeypatch.setattr(loop_rolling, "SAVING", saving)
        described, codes = generate_code(made.lowered, lambda text, _: object_code(text, 0))
        assert bool(described.rows) == (longest < 0)
        programs.append(bind(described, codes))
    return programs


def values(program: Program) -> list[np.ndarray]:
    constants, inputs = program.constants(np.array(program.defaults)), np.array(program.input_defaults)
    state = program.start(constants)
    noise = np.random.default_rng(1).normal(size=len(state))
    state = state + noise * 1e-3 * (np.abs(state).max(initial=1e-3) + 1e-6)
    at = (1.1e-4, state, inputs, constants, program.switches(1e-4, constants))
    found = [getattr(program, name)(*at) for name in FUNCTIONS]
    if program.solved is not None:
        found.append(program.solved(*at))
    return [constants, program.start(constants), program.nominal(constants), program.instants(constants), *found]


@pytest.mark.few(6)
@pytest.mark.machine_code
@pytest.mark.parametrize("name", MANY)
def test_kernels_compute_bit_by_bit_what_lines_compute(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = compiled(MODELS / f"{name}.bg", everything=True)
    for one, other in zip(*map(values, by_lines_and_by_kernels(made, monkeypatch)), strict=True):
        np.testing.assert_array_equal(one, other)


TEXTS = {
    "flat ladder": lambda n: large_models.rc_ladder(n),
    "ladder as an array": lambda n: large_models.rc_ladder_array(n),
    "coils": lambda n: large_models.lc_ladder(n),
    "mesh": lambda n: large_models.network(large_models.mesh_edges(round(n**0.5)), round(n**0.5) ** 2),
    "star": lambda n: large_models.network(large_models.star_edges(n), n + 1),
    "random": lambda n: large_models.network(large_models.random_edges(n, n // 2), n),
    "band": lambda n: row_of_resistors(n),
    "multibonds": lambda n: MULTIBONDS.replace("COUNT", str(n)),
}
MULTIBONDS = """model Block {
  parameter M = [[2 kg, 0.1 kg, 0], [0.1 kg, 1.5 kg, 0.2 kg], [0, 0.2 kg, 1 kg]]
  parameter K = [[200 [N/m], 10 [N/m], 0], [10 [N/m], 150 [N/m], 20 [N/m]], [0, 20 [N/m], 100 [N/m]]]
  port left: translation[3], right: translation[3]
  1 body : translation[3]
  0 node : translation[3]
  I mass(p: translation[3])   : p = M*f
  R loss(p: translation[3])   : e = 0.3 [N*s/m]*f
  C spring(s: translation[3]) : e = K*q
  left => node => spring
  node => body => mass
  body => loss
  body => right
}
model Chain {
  parameter n = COUNT
  for i in 1..n { Block b[i] }
  for i in 1..n-1 { b[i].right => b[i+1].left }
  for i in 1..3 { Se push[i] : F = 1 N/i; Sf wall[i] : v = 0 }
  push => b[1].left
  b[n].right => wall
  output y = b[n-1].body.v[1]
}"""


@pytest.mark.machine_code
@pytest.mark.parametrize("kind", ["mesh", "star", "random", "coils", "band"])
def test_of_large_networks_too(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = compiled(TEXTS[kind](64), everything=True)
    for one, other in zip(*map(values, by_lines_and_by_kernels(made, monkeypatch)), strict=True):
        np.testing.assert_array_equal(one, other)


def code_of(text: str) -> tuple[ProgramImage, list[str], list[int]]:
    texts: list[str] = []

    def keeping(part: str, level: int) -> bytes:
        texts.append(part)
        return object_code(part, level)

    described, codes = generate_code(compiled(text).lowered, keeping)
    return described, texts, [len(code) for code in codes]


@pytest.mark.machine_code
@pytest.mark.parametrize("kind", ["flat ladder", "ladder as an array", "coils", "star"])
def test_code_does_not_grow_with_the_number_of_instances(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_rolling, "LONGEST_IN_LINES", 0)  # also where lines would do
    described, texts, sizes = code_of(TEXTS[kind](50))
    longer, more, others = code_of(TEXTS[kind](500))
    assert sum(sizes) < 30_000
    for few, many, size, other in zip(texts, more, sizes, others, strict=True):
        assert few.count("\ndefine ") == many.count("\ndefine ")
        assert few.count("\n") == many.count("\n")
        assert other == size
    assert longer.operations == pytest.approx(10 * described.operations, rel=0.05)  # what is computed does grow
    assert longer.differentiated == described.differentiated <= 16  # laws, whatever their number of uses
    rows, before = (sum(len(r.streams) for r in d.rows) for d in (longer, described))
    assert rows == pytest.approx(10 * before, rel=0.1)


@pytest.mark.machine_code
def test_blocks_of_multibonds_with_matrices_in_their_laws_are_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_rolling, "LONGEST_IN_LINES", 0)
    (described, _, sizes), (longer, _, others) = (code_of(TEXTS["multibonds"](n)) for n in (5, 15))
    assert longer.operations > 2.5 * described.operations
    assert sum(others) < 1.02 * sum(sizes) < 60_000
    assert longer.differentiated == described.differentiated


def test_a_file_of_c_has_loops_over_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only its data grow with the model."""
    monkeypatch.setattr(loop_rolling, "LONGEST_IN_LINES", 0)
    texts = [write_c(compiled(TEXTS["multibonds"](n)).lowered) for n in (4, 8)]
    code, longer = (len(re.findall(r"^ .*;$", text, re.MULTILINE)) for text in texts)
    assert 500 < longer <= code
    (rows, numbers), more = (
        [text.partition(f"{name}[] = ")[2].partition("}")[0].count(",") for name in ("kernel_rows", "numbers")]
        for text in texts
    )
    assert 1.5 * rows < more[0] < 2.5 * rows and numbers == more[1]


@pytest.mark.machine_code
@pytest.mark.parametrize("kind", ["mesh", "random"])
def test_code_of_networks_grows_with_kinds_of_nodes_alone(kind: str) -> None:
    _, _, sizes = code_of(TEXTS[kind](225))
    _, _, others = code_of(TEXTS[kind](900))
    assert sum(others) < 1.5 * sum(sizes)
    assert sum(others) < 100_000


@pytest.mark.machine_code
def test_a_ladder_written_flat_is_the_same_code_as_an_array() -> None:
    _, flat, _ = code_of(TEXTS["flat ladder"](300))
    _, array, _ = code_of(TEXTS["ladder as an array"](300))
    assert abs(flat[0].count("\n") - array[0].count("\n")) <= 0.2 * flat[0].count("\n")


@pytest.mark.machine_code
def test_small_models_stay_lines() -> None:
    described, _ = generate_code(compiled(MODELS / "manipulator.bg").lowered, lambda text, _: object_code(text, 0))
    assert not described.rows
