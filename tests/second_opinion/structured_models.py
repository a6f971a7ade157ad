"""Random models of multibonds, matrices, conditional parts, parameter sets and loops of signals, each written twice.

The product reads bonds of width n, choices and equations; the second opinion the same model by single bonds and closed forms,
with what is chosen written out. So a mistake of what both read, the compiler's semantics, is seen too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from tests.second_opinion.random_models import SPECIALS, Example, Part, Writer, special, varied

ITEM = re.compile(r"\b([CIgMz]\w*)\[(\d)\]")
STORED = re.compile(r"\.b\[(\d)\]\.[qp]\b")
LOOPS = ("linear", "tanh", "cubic", "pair", "kink", "force", "vector", "rate", "space", "each", "orbit")


def singly(line: str) -> str:
    """A line that names items, with single names."""
    return ITEM.sub(r"\1_\2", STORED.sub(r".b\1", line))


def total(terms: Sequence[str]) -> str:
    return " + ".join(terms)


@dataclass(frozen=True)
class Group:
    """A junction of some width."""

    name: str
    kind: str
    text: str  # of the width
    width: int

    @property
    def items(self) -> list[str]:
        return [f"{self.name}[{i}]" for i in self.numbers]

    @property
    def numbers(self) -> range:
        return range(1, self.width + 1)


class Shapes(Writer):
    """Parts of one random model of multibonds."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        rng = self.rng
        self.n, self.flag, self.word = rng.randint(1, 3), rng.random() < 0.5, rng.choice(["alpha", "beta", "gamma"])
        self.structure: dict[str, object] = {}
        self.tied = False  # whether storages of different groups may follow from one another
        if rng.random() < 0.5:  # set from outside, where the text has other ones
            self.structure = {"n": self.n, "flag": self.flag, "word": self.word, "material": "Hard"}
            first = (self.n + rng.randint(0, 1), rng.random() < 0.5, rng.choice(["alpha", "beta", "gamma"]), "Soft")
        else:
            first = (self.n, self.flag, self.word, "Hard")
        self.numbers = {name: round(rng.uniform(0.5, 2), 3) for name in ("k", "r")}
        sets = f"parameters Soft {{ k = 0.7; r = 0.9 }}\nparameters Hard {{ k = {self.numbers['k']}; r = {self.numbers['r']} }}\n"
        choices = (
            f"parameter n = {first[0]}, flag = {str(first[1]).lower()}, word: {{ alpha, beta, gamma }} = {first[2]}"
        )
        lines = (choices, f"parameter material: parameters = {first[3]}")
        self.parts.append(Part(lines, needed=True, singly=(), before=sets))

    def both(self, rich: Sequence[str], single: Sequence[str], traits: str = "", needed: bool = False, before: str = "") -> None:  # fmt: skip
        """A part in its two forms, perhaps in a branch beside another one of the same names."""
        rich = list(rich)
        if self.rng.random() < 0.3 and not before:
            rich, traits = self.branches(rich), traits + " conditional"
        self.parts.append(Part(tuple(rich), frozenset(traits.split()), needed, tuple(single), before))

    def condition(self) -> tuple[str, bool]:
        rng = self.rng
        other, number = rng.choice(["alpha", "beta", "gamma"]), rng.randint(1, 3)
        return rng.choice(
            [
                ("flag", self.flag), ("not flag", not self.flag), (f"word == {other}", self.word == other),
                (f"n > {number}", self.n > number), (f"n == {number} or flag", self.n == number or self.flag),
                (f"word != {other} and n < {number}", self.word != other and self.n < number),
            ]
        )  # fmt: skip

    def branches(self, lines: list[str], depth: int = 0) -> list[str]:
        """These lines in the branch that is taken, others of the same names in the other one."""
        text, true = self.condition()
        other = [re.sub(r"\b(p_\d+)\b", r"(1.7*\1)", line) for line in lines]
        if not depth and self.rng.random() < 0.3:
            lines = self.branches(lines, 1)
        first, second = (lines, other) if true else (other, lines)
        return [f"if {text} {{", *first, "} else {", *second, "}"]

    # ------------------------------------------------------------ matrices
    def matrix(self, rows: tuple[str, int], columns: tuple[str, int], symmetric: bool) -> tuple[str, list[str], Callable[[int, int], str]]:  # fmt: skip
        """Name, lines and entries of a matrix with a strong diagonal."""
        name, a, b = self.name("K"), self.number(), self.number(0.1, 0.3)
        bend = f"{b}/(i + j)" if symmetric else f"{b}*(i - 1.6*j)/5"

        def entry(i: int, j: int) -> str:
            mixed = re.sub(r"\bi\b", str(i), re.sub(r"\bj\b", str(j), bend))
            return f"({a} + 0.1*{i})" if i == j else f"({mixed})"

        if rows[0].isdigit() and columns[0].isdigit() and self.rng.random() < 0.7:
            whole = ", ".join(
                "[" + ", ".join(entry(i, j) for j in range(1, columns[1] + 1)) + "]" for i in range(1, rows[1] + 1)
            )
            return name, [f"constant {name} = [{whole}]"], entry
        inner = f"constant {name}[i, j] = {a} + 0.1*i if i == j else {bend}"
        return name, [f"for i in 1..{rows[0]} {{", f"for j in 1..{columns[0]} {{ {inner} }}", "}"], entry

    # ------------------------------------------------------------ elements of a group
    def storage(self, g: Group, letter: str) -> None:
        """A `C` or `I` of all bonds of a group, or an array of them."""
        name, k, a, rng = self.name(letter), self.number(), self.number(0.05, 0.2), self.rng
        s, other = ("q", "e") if letter == "C" else ("p", "f")
        kind = rng.choice(["array", "list", "matrix", "energy", "energy matrix"])
        place, value = rng.choice(list(g.numbers)), self.number(-0.5, 0.5)
        begins = letter in self.startable and rng.random() < 0.6
        self.startable = "" if begins else self.startable
        if kind == "array":
            law = f"{other} = ({k} + 0.1*i)*{s}" if letter == "C" else f"{s} = ({k} + 0.1*i)*{other}"
            start = f" {{ start {s} = {value}*i }}" if begins else ""
            rich = [f"for i in 1..{g.text} {{ {letter} {name}[i] : {law}{start} }}", f"{g.name} => {name}"]
            single = []
            for i in g.numbers:
                single += [
                    re.sub(r"\bi\b", str(i), f"{letter} {name}_{i} : {law}{start}"), f"{g.name}_{i} -> {name}_{i}",
                ]  # fmt: skip
            self.both(rich, single, "array", needed=True)
            self.states += [f"{name}[{i}].{s}" for i in g.numbers]
            return
        lines: list[str] = []
        b = [f"b{i}" for i in g.numbers]
        squares = total([f"{x}^2" for x in b])
        if kind == "list":
            law = f"e = {k}*q" if letter == "C" else f"b.p = {k}*b.f"
            laws = [f"{x}.e = {k}*{x}" if letter == "C" else f"{x} = {k}*{x}.f" for x in b]
        elif kind == "energy":
            law = f"energy = {k}/2*dot({s}, {s}) + {a}*dot({s}, {s})^2"
            laws = [f"energy = {k}/2*({squares}) + {a}*({squares})^2"]
        else:
            m, lines, entry = self.matrix((g.text, g.width), (g.text, g.width), True)
            law = f"energy = transpose({s})*{m}*{s}/2" if kind == "energy matrix" else ("e = " if letter == "C" else "p = ") + f"{m}*{'q' if letter == 'C' else 'f'}"  # fmt: skip
            if kind == "energy matrix":
                laws = ["energy = " + total([f"{entry(i, j)}*b{i}*b{j}/2" for i in g.numbers for j in g.numbers])]
            elif letter == "C":
                laws = [f"b{i}.e = " + total([f"{entry(i, j)}*b{j}" for j in g.numbers]) for i in g.numbers]
            else:
                laws = [f"b{i} = " + total([f"{entry(i, j)}*b{j}.f" for j in g.numbers]) for i in g.numbers]
        start = f" {{ start b[{place}].{s} = {value} }}" if begins else ""
        whole = begins and rng.random() < 0.4 and g.text.isdigit()
        if whole:
            start = f" {{ start b.{s} = [{', '.join(f'{value}*{i}' for i in g.numbers)}] }}"
        single_start = f" {{ start b{place} = {value} }}" if begins else ""
        if whole:
            single_start = " { " + "; ".join(f"start b{i} = {value}*{i}" for i in g.numbers) + " }"
        self.both(
            [*lines, f"{letter} {name}(b: untyped[{g.text}]) : {law}{start}", f"{g.name} => {name}"],
            [
                f"{letter} {name}({', '.join(b)}) : {', '.join(laws)}{single_start}",
                *(f"{g.name}_{i} -> {name}.b{i}" for i in g.numbers),
            ],
            kind.replace(" ", "-"),
            needed=True,
        )
        self.states += [f"{name}.b[{i}].{s}" for i in g.numbers]

    def losses(self, g: Group) -> None:
        name, r = self.name("R"), self.number()
        b = [f"b{i}" for i in g.numbers]
        kind, lines = self.rng.choice(["list", "matrix", "norm", "leg"]), []
        before = ""
        if kind == "list":
            law, laws = f"e = {r}*f", [f"{x}.e = {r}*{x}.f" for x in b]
        elif kind == "norm":
            law = f"e = {r}*(1 + dot(f, f))*f"
            laws = [f"{x}.e = {r}*(1 + {total([f'{y}.f^2' for y in b])})*{x}.f" for x in b]
        elif kind == "matrix":
            m, lines, entry = self.matrix((g.text, g.width), (g.text, g.width), False)
            law = f"e = {m}*f"
            laws = [f"b{i}.e = " + total([f"{entry(i, j)}*b{j}.f" for j in g.numbers]) for i in g.numbers]
        else:
            self.leg(g)
            return
        self.both(
            [*lines, f"R {name}(b: untyped[{g.text}]) : {law}", f"{g.name} => {name}"],
            [f"R {name}({', '.join(b)}) : {', '.join(laws)}", *(f"{g.name}_{i} -> {name}.b{i}" for i in g.numbers)],
            f"loss-{kind}",
            before=before,
        )

    def leg(self, g: Group) -> None:
        """An instance with a port of some width, values from a set of parameters, and a part that a condition adds."""
        name, rng = self.name("L"), self.rng
        text, true = self.condition() if rng.random() < 0.5 else (f"{str(self.flag).lower()}", self.flag)
        model = f"""plain model Leg{name} {{
  parameter size = 1, k = 1, r = 1, soft = false
  port top: untyped[size]
  1 here : untyped[size]
  top => here
  R loss(b: untyped[size]) : e = r*f
  here => loss
  if soft {{
    C spring(b: untyped[size]) : e = k*q
    here => spring
  }}
}}
"""
        k, r = self.numbers["k"], self.numbers["r"]
        handed, single = rng.choice(["material", "Hard"]), []
        extra = ""
        if rng.random() < 0.4:
            r, extra = 0.5, ", r = 0.5"
        for i in g.numbers:
            single += [f"1 {name}_{i}", f"R {name}r_{i} : e = {r}*f", f"{g.name}_{i} -> {name}_{i} -> {name}r_{i}"]
            if true:
                single += [f"C {name}c_{i} : e = {k}*q", f"{name}_{i} -> {name}c_{i}"]
        rich = f"Leg{name} {name} {{ size = {g.text}, parameters = {handed}, soft = {text}{extra} }}"
        self.both([rich, f"{g.name} => {name}.top"], single, "leg set", before=model)

    def sources(self, g: Group) -> None:
        name, a, w = self.name("S"), self.number(), self.number(2, 6)
        letter, what = ("Se", "e") if g.kind == "1" else ("Sf", "f")
        law = f"{what} = {a}*sin({w}*time + i)"
        rich = [f"for i in 1..{g.text} {{ {letter} {name}[i] : {law} }}", f"{name} => {g.name}"]
        single = []
        for i in g.numbers:
            single += [re.sub(r"\bi\b", str(i), f"{letter} {name}_{i} : {law}"), f"{name}_{i} -> {g.name}_{i}"]
        self.both(rich, single, "sources", needed=True)

    # ------------------------------------------------------------ from group to group
    def joined(self, a: Group, b: Group) -> None:
        """Directly, by a splitter, or by a transformer or gyrator with a matrix, which may turn with a state."""
        rng = self.rng
        direct = a.width == b.width and a.text == b.text and rng.random() < 0.4
        if direct:
            single = [f"{a.name}_{i} -> {b.name}_{i}" for i in a.numbers]
            if a.text.isdigit() and a.width > 1 and rng.random() < 0.4:
                name = self.name("h")
                ports = ", ".join(str(i) for i in a.numbers)
                if rng.random() < 0.5:
                    ports = ", ".join("xyz"[i - 1] for i in a.numbers)
                    rich = [
                        f"splitter {name}({ports})",
                        *(f"{a.name}[{i}] -> {name}.{'xyz'[i - 1]}" for i in a.numbers),
                    ]
                    name2 = self.name("h")
                    rich += [f"splitter {name2}({ports})", f"{name} => {name2}"]
                    rich += [f"{name2}.{'xyz'[i - 1]} -> {b.name}[{i}]" for i in a.numbers]
                else:
                    rich = [f"{a.name}[{i}] -> {b.name}[{i}]" for i in a.numbers]
                self.both(rich, single, "splitter", needed=True)
            else:
                self.both([f"{a.name} => {b.name}"], single, "direct", needed=True)
            return
        name, letter = self.name("T"), rng.choice(["TF", "TF", "GY"]) if self.tied else "TF"
        inner = "f" if letter == "TF" else "e"
        turned = a.text == b.text == "2" and bool(self.states) and rng.random() < 0.6
        if turned:
            angle, letter = rng.choice(self.states), "M" + letter
            matrix, lines = f"rotation({angle})", []
            flat = singly(angle)
            wave = {(1, 1): f"cos({flat})", (1, 2): f"-sin({flat})", (2, 1): f"sin({flat})", (2, 2): f"cos({flat})"}
            entry: Callable[[int, int], str] = lambda i, j: wave[i, j]  # noqa: E731
        else:
            matrix, lines, entry = self.matrix((b.text, b.width), (a.text, a.width), False)
        rich = [
            *lines,
            f"{letter} {name}(a: untyped[{a.text}], b: untyped[{b.text}]) : b.{inner} = {matrix}*a.f",
            f"{a.name} => {name}.a",
            f"{name}.b => {b.name}",
        ]
        single = []
        for j in a.numbers:
            single += [f"1 {name}a{j}", f"{a.name}_{j} -> {name}a{j}"]
        for i in b.numbers:
            single += [f"{'0' if inner == 'f' else '1'} {name}b{i}", f"{name}b{i} -> {b.name}_{i}"]
            for j in a.numbers:
                single += [
                    f"{letter} {name}_{i}{j} : {inner}2 = {entry(i, j)}*f1",
                    f"{name}a{j} -> {name}_{i}{j} -> {name}b{i}",
                ]
        self.both(rich, single, f"{letter} by-matrix", needed=True)

    # ------------------------------------------------------------ signals
    def signals(self, at: str) -> None:
        """A loop of signals, or equations, that drives something."""
        rng = self.rng
        name, a, k = self.name("z"), self.number(0.3, 1.2), self.number(0.3, 1.5)
        s, t = rng.choice(self.states), rng.choice(self.states)
        kind = rng.choice(LOOPS)
        drive = f"{name}_u"
        match kind:
            case "linear":
                rich = [f"signal {name} = {a}*(0.3 - {s} - {name}v), {name}v = 0.4*{name} + 0.1*{t}"]
                single = [f"signal {name} = {a}*(0.3 - {s} - 0.1*{t})/(1 + 0.4*{a})"]
            case "tanh":
                rich, single = [f"signal {name} = {s} - {a}*tanh({name})"], [f"solve {name} + {a}*tanh({name}) = {s} for {name} = 0"]  # fmt: skip
                if rng.random() < 0.5:
                    rich, single = single, rich
            case "cubic" | "rate":
                rich = [f"solve {name}^3 + {a}*{name} = {s} for {name} = 0.1"]
                single = [f"signal {name} = 2*sqrt({a}/3)*sinh(asinh(1.5*({s})/{a}*sqrt(3/{a}))/3)"]
                if kind == "rate":
                    rich.append(f"output {name}d = der({name})")
                    single.append(f"output {name}d = der({s})/(3*{name}^2 + {a})")
            case "pair":
                rich = [
                    f"solve {name} + {a}*{name}w = {s}, {name}w - {a}*tanh({name}) = {t} for {name} = 0, {name}w = 0"
                ]
                single = [f"signal {name} = {s} - {a}*{name}w, {name}w = {t} + {a}*tanh({name})"]
            case "kink":
                rich = [f"signal {name} = {s} - {a}*max({name} - 0.05, 0)"]
                single = [f"signal {name} = {s} if {s} < 0.05 else ({s} + 0.05*{a})/(1 + {a})"]
            case "force":
                reading = f"{at}.f"
                rich = [f"signal {name} = -{k}*(0.5*{name} + {reading})"]
                single = [f"signal {name} = -{k}*{reading}/(1 + 0.5*{k})"]
            case "vector":
                m, lines, e = self.matrix(("2", 2), ("2", 2), False)
                form = rng.choice([f"solve {m}*{name}w = [{s}, {t}] for {name}w = [0, 0]", f"signal {name}w = inverse({m})*[{s}, {t}]", f"signal {name}w = solve({m}, [{s}, {t}])"])  # fmt: skip
                rich = [*lines, form, f"signal {name} = {name}w[1] - {name}w[2]"]
                det = f"({e(1, 1)}*{e(2, 2)} - {e(1, 2)}*{e(2, 1)})"
                single = [
                    f"signal {name} = (({e(2, 2)}*{s} - {e(1, 2)}*{t}) - ({e(1, 1)}*{t} - {e(2, 1)}*{s}))/{det}",
                ]
            case "space":
                m, lines, e = self.matrix(("2", 2), ("2", 2), False)
                rich = [*lines, f"signal {name}w = integral(-1*({m}*{name}w) + [{s}, {t}], [0.1, 0])", f"signal {name} = {name}w[1] + {name}w[2]"]  # fmt: skip
                single = [
                    f"signal {name}x = integral(-{e(1, 1)}*{name}x - {e(1, 2)}*{name}y + {s}, 0.1)",
                    f"signal {name}y = integral(-{e(2, 1)}*{name}x - {e(2, 2)}*{name}y + {t}, 0)",
                    f"signal {name} = {name}x + {name}y",
                ]
            case "each":
                rich = [
                    f"signal {name}w = [{s}, {t}]",
                    f"for i in 1..2 {{ signal {name}s[i] = {name}w[i] - {a}*{name}s[i]*abs({name}s[i])/i }}",
                    f"signal {name} = {name}s[1] + {name}s[2]",
                ]
                one = "sign({0})*2*abs({0})/(1 + sqrt(1 + 4*{1}*abs({0})))"
                single = [f"signal {name} = " + one.format(s, a) + " + " + one.format(t, f"({a}/2)")]
            case _:
                e, w = self.number(0.2, 0.6), self.number(1, 3)
                rich = [f"signal {name} = {w}*time + {e}*sin({name})"]
                single = [f"solve {name} - {e}*sin({name}) = {w}*time for {name} = 0"]
        own = [f"output {name}o = {name}", f"MSe {drive} : e = {'' if kind == 'force' else '0.3*'}{name}{'*cos(time)' if kind == 'orbit' else ''}", f"{drive} -> {at}"]  # fmt: skip
        if rng.random() < 0.3:
            own += [f"mode {name}n = 0", f"when {name} > {rng.choice([0.04, 0.1])} {{ {name}n = {name}n + 1 }}", f"output {name}c = {name}n"]  # fmt: skip
        self.both([*rich, *own], [singly(x) for x in [*single, *own]], f"signals {kind}")

    def extra(self, method: Callable[[], None]) -> None:
        """A part of the other generator at single bonds, perhaps in a branch."""
        before = len(self.parts)
        method()
        for place in range(before, len(self.parts)):
            part = self.parts[place]
            single = tuple(singly(x) for x in part.lines)
            lines = list(part.lines)
            if self.rng.random() < 0.3:
                lines = self.branches(lines)
            self.parts[place] = replace(part, lines=tuple(lines), singly=single)


def structured(seed: int, structure: int = 8) -> Example:
    """A random model of multibonds; `structure` seeds in a row share their structure and differ in parameters."""
    w = Shapes(seed // structure)
    rng = w.rng
    specials = rng.sample(SPECIALS, rng.randint(0, 2))
    if {"friction", "valve", "branch"} & set(specials):
        w.startable = "C"
    groups: list[Group] = []
    kind = rng.choice("01")
    w.tied = rng.random() < 0.5
    if w.tied:  # what is not said of a start would be chosen
        w.startable = ""
    for number in range(rng.randint(1, 3)):
        text, width = rng.choice([("n", w.n), ("n", w.n), ("n+1", w.n + 1), ("2", 2), ("3", 3)])
        if groups and (not w.tied or rng.random() < 0.5):
            text, width = groups[-1].text, groups[-1].width
        g = Group(f"g{number}", kind, text, width)
        w.parts.append(
            Part(
                (f"{kind} {g.name} : untyped[{text}]",),
                needed=True,
                singly=tuple(f"{kind} {singly(i)}" for i in g.items),
            )
        )
        w.storage(g, "I" if kind == "1" else "C")
        if groups:
            w.joined(groups[-1], g)
        groups.append(g)
        kind = kind if w.tied and rng.random() < 0.3 else "10"[int(kind)]
    for g in groups:
        if rng.random() < 0.8:
            w.losses(g)
        if rng.random() < 0.3:
            w.storage(g, "C" if g.kind == "1" else "I")
    w.sources(rng.choice(groups))
    ones = [i for g in groups if g.kind == "1" for i in g.items]
    zeros = [i for g in groups if g.kind == "0" for i in g.items]
    for name in specials:
        w.extra(lambda name=name: special(w, name, ones, zeros))  # type: ignore[misc]
    for _ in range(rng.randint(0, 2) if ones else 0):
        w.signals(rng.choice(ones))
    for number, state in enumerate(w.states[:5]):
        w.parts.append(
            Part((f"output y{number} = {state}",), needed=True, singly=(singly(f"output y{number} = {state}"),))
        )
    g = groups[-1]
    letter = "e" if g.kind == "0" else "f"
    squares = total([f"{singly(i)}.{letter}^2" for i in g.items])
    w.parts.append(Part((f"output s = dot({g.name}.{letter}, {g.name}.{letter})",), needed=True, singly=(f"output s = {squares}",)))  # fmt: skip
    example = Example(seed, tuple(w.parts), w.parameters, round(rng.uniform(1.0, 2.5), 2), structure=w.structure)
    return varied(example, seed % structure)
