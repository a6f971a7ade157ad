"""Mutants of small texts: the changes that are made, those that are not, and the switches between them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.compiling import ROOT
from tests.mutation.mutants import mutants_of
from tests.mutation.switches import SWITCH, Switch, switched


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a = b + c\n", {"a = b - c"}),
        ("a = b * (c)\n", {"a = b / (c)", "a = b + (c)"}),
        ("a = b < c\n", {"a = b <= c", "a = b > c"}),
        ("a = b and c or d\n", {"a = b or c or d", "a = b and c and d"}),
        ("a = 2\n", {"a = 3", "a = 1"}),
        ("a = 2.5\n", {"a = 5.0", "a = 1.25"}),
        ("a = not b\n", {"a = b"}),
        ("a = 'é' + b\n", {"a = 'é' - b"}),
        ("if a:\n    b()\n", {"if (not (a)):\n    b()"}),
        ("a: int | None = b\n", set()),
        ("def a(b: int | str) -> int | None: ...\n", set()),
        ("A = B | C\n", set()),
        ("a = f'{b + c}'\n", set()),
    ],
)
def test_changes_of_a_line(tmp_path: Path, text: str, expected: set[str]) -> None:
    path = tmp_path / "room.py"
    path.write_text(text, encoding="utf-8")
    assert {m.applied(text).strip() for m in mutants_of(tmp_path, path)} == expected


def test_every_mutant_of_a_room_differs_in_its_line() -> None:
    path = ROOT / "compiler" / "source.py"
    source = path.read_text(encoding="utf-8")
    mutants = mutants_of(ROOT, path)
    assert len(mutants) > 10
    for mutant in mutants:
        assert source[mutant.start : mutant.end] == mutant.before != mutant.after
        assert source.count("\n", 0, mutant.start) + 1 >= mutant.line


def test_switches_let_each_mutant_act_alone(tmp_path: Path) -> None:
    text = (
        "LIMIT = 3\n"
        "def f(x, y=2):\n"
        "    match y:\n"
        "        case 5:\n"
        "            return 0\n"
        "    z = [a * x - y for a in (1, 2) if a < x]\n"
        "    return sum(z, start=7) if x > LIMIT and not y == -1 else x\n"
    )
    path = tmp_path / "room.py"
    path.write_text(text, encoding="utf-8")
    mutants = dict(enumerate(mutants_of(tmp_path, path)))
    program = compile(switched(text, mutants.items()), "room", "exec")

    def values(code: object, switch: Switch) -> list[object]:
        namespace: dict[str, object] = {SWITCH: switch}
        exec(code, namespace)
        found = []
        for arguments in [(1,), (3,), (4,), (4, 5), (4, 6), (4, 4), (5, -1), (5, 1)]:
            try:
                found.append(namespace["f"](*arguments))
            except ZeroDivisionError:
                found.append(None)
        return found

    sound = Switch()
    assert values(program, sound) == values(compile(text, "room", "exec"), Switch()) and sound.passed == set(mutants)
    assert len(mutants) > 25
    for number, mutant in mutants.items():
        assert values(program, Switch(number)) == values(compile(mutant.applied(text), "room", "exec"), Switch()), (
            mutant
        )
