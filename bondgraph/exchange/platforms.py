"""Platforms of functional mock-up units: folders of their libraries, and what a library may take from the system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_MATHEMATICS = frozenset((
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil", "copysign", "cos", "cosh", "erf", "erfc", "exp", "exp2", "expm1",
    "fabs", "floor", "fma", "fmod", "hypot", "lgamma", "log", "log10", "log1p", "log2", "pow", "remainder", "rint", "round", "sin", "sinh", "sqrt",
    "tan", "tanh", "tgamma", "trunc",
))  # fmt: skip
_MEMORY = frozenset(("calloc", "free", "malloc", "memcmp", "memcpy", "memmove", "memset", "strcmp", "strlen"))
_GNU = (("libm.so.6", _MATHEMATICS), ("libc.so.6", _MEMORY))


@dataclass(frozen=True, slots=True)
class FmuPlatform:
    """A platform: its word for us and for LLVM, the folders of FMI 2.0 and 3.0, the ending of its libraries, and those of the system."""

    word: str
    folders: Mapping[str, str]
    system: tuple[tuple[str, frozenset[str]], ...]
    ending: str = ".so"


PLATFORMS: Mapping[str, FmuPlatform] = {
    p.word: p
    for p in (
        FmuPlatform("linux64", {"2.0": "linux64", "3.0": "x86_64-linux"}, _GNU),
        FmuPlatform("linux-aarch64", dict.fromkeys(("2.0", "3.0"), "aarch64-linux"), _GNU),
    )
}
