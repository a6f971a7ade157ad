"""Two small objects for the tests of the linker, and their damage."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable

from compiler.linking.layout import SharedLibrary
from compiler.linking.link import link
from compiler.linking.object_file import LinkError

FIRST = """
@weights = private constant [3 x double] [double 2.0, double 3.0, double 5.0]
@table = internal global [2 x ptr] [ptr @twice, ptr @weighted]
@count = internal global i64 0
declare double @sin(double)
declare double @cos(double)
declare double @other(double)
define double @twice(double %x) {
  %y = fadd double %x, %x
  ret double %y
}
define double @weighted(double %x) {
  %p = getelementptr [3 x double], ptr @weights, i64 0, i64 2
  %w = load double, ptr %p
  %y = fmul double %x, %w
  ret double %y
}
define double @circle(double %x) {
  %s = call double @sin(double %x)
  %c = call double @cos(double %x)
  %y = fadd double %s, %c
  ret double %y
}
define double @chosen(i64 %n, double %x) {
  %p = getelementptr [2 x ptr], ptr @table, i64 0, i64 %n
  %f = load ptr, ptr %p
  %y = call double %f(double %x)
  ret double %y
}
define double @both(double %x) {
  %y = call double @other(double %x)
  ret double %y
}
define i64 @counted() {
  %n = load i64, ptr @count
  %m = add i64 %n, 1
  store i64 %m, ptr @count
  ret i64 %m
}
"""
# A function of the same name in each object: each calls its own.
SECOND = """
define double @twice(double %x) {
  %y = fmul double %x, 20.0
  ret double %y
}
define double @other(double %x) {
  %y = call double @twice(double %x)
  ret double %y
}
"""
EXPORTED = ("twice", "weighted", "circle", "chosen", "both", "counted")
# Numbers by their width.
WIDE = {2: "<H", 4: "<I", 8: "<Q"}


def changed(good: bytes, fields: list[tuple[int, int]], chance: random.Random) -> bytes:
    """An object with fields set to what is near, far, another's or nothing, bytes changed, or its end cut off."""
    data = bytearray(good)
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        at, width = chance.choice(fields)
        if chance.random() < 0.2 or at + width > len(data):
            at = chance.randrange(len(data))
            data[at] = chance.choice((chance.randrange(256), data[at] ^ 1 << chance.randrange(8)))
            continue
        (value,) = struct.unpack_from(WIDE[width], data, at)
        other, wide = chance.choice(fields)
        others = struct.unpack_from(WIDE[wide], good, other)[0]
        near = value + chance.choice((-16, -8, -4, -1, 1, 4, 8, 16))
        whole = chance.choice((0, 1, near, others, 2 * value, len(data), -1, 1 << 63, 1 << 31, chance.getrandbits(64)))
        struct.pack_into(WIDE[width], data, at, whole % (1 << 8 * width))
    return bytes(data[: chance.randrange(1, len(data))] if chance.random() < 0.02 else data)


def link_damaged(
    good: list[bytes], wanted: SharedLibrary, fields: list[tuple[int, int]], check: Callable[[bytes], None], seed: int
) -> None:
    """Link 2 200 times with the first object damaged: never another exception than a refusal, never a library that does not pass the check; where no field
    changed what comes to memory, the library is the same. Each of these answers is given often."""
    chance, whole = random.Random(seed), link(good, wanted)
    answers = {"same": 0, "other": 0, "refused": 0}
    for _ in range(2200):
        try:
            image = link([changed(good[0], fields, chance), *good[1:]], wanted)
        except LinkError:
            answers["refused"] += 1
        else:
            answers["same" if image == whole else "other"] += 1
            check(image)
    assert min(answers.values()) > 100, answers
