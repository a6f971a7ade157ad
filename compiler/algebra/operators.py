"""Table of operators: all that the compiler knows of each of them, one row per operator.

Every other module reads its part from here: values, derivatives, inverses, units, ranges, sympy, numpy, C and LLVM. A function of the
language is one row. Only operators that are no function of their operands alone have rules elsewhere: sums, products and powers (their
derivatives and texts depend on numbers among the operands), choices, and curves through points (`table.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Literal

from ..fast_dataclass import dataclass
from . import interpolate

REALS = (-math.inf, math.inf)

# Units of a function of the language: "bare": of bare numbers; "same": of quantities of one unit, which is that of the result; "ratio": of
# quantities of one unit, the result is a bare number; "root": the result has the unit to the 1/2; "": no function of the language.
Units = Literal["bare", "same", "ratio", "root", ""]
# Course of a function of one operand over an interval; "": a rule of its own in `intervals.py`.
Course = Literal["rising", "falling", "jumping", ""]


@dataclass(frozen=True, slots=True)
class Operator:
    """A row. The defaults describe a smooth function of one bare number with one name in Python, numpy, sympy and C.

    Derivatives and inverses are functions of `f`, which applies an operator by its name, of the result y and of the operands.
    """

    name: str
    value: Callable[..., float | bool]  # for floats; raises ArithmeticError or ValueError where there is none
    partials: tuple[Callable[..., Any], ...] = ()  # (f, y, *operands) -> partial derivative by each operand
    inverse: Callable[..., Any] | None = None  # (f, y) -> the one real operand
    arity: int = 1  # 0: any number of operands
    kind: Literal["function", "condition", "curve", "slope"] = "function"
    units: Units = "bare"
    usage: str = ""  # a call, for messages; "": that of one operand x
    course: Course = ""
    domain: tuple[float, float] = REALS  # of the first operand
    gaps: bool = False  # True if there are numbers within the domain without a value
    never_negative: bool = False
    smooth: bool = True  # False if it has a jump or a kink
    narrow: bool = False  # True if it may be narrow around a zero of its argument (a bell, a step), or has no derivative there (a root)
    broad: bool = False  # True if as a function of time it moves everywhere as fast as it ever does, or at places that are instants
    sympy: str | Callable[..., Any] = ""  # name in sympy, or a function of the module and the operands; "": `name`
    numpy: str = ""  # text of the function in a module; "": `np.name`
    numpy_source: str = ""  # its definition if it is not numpy's own
    c: str = ""  # function in C, or the sign of a condition; "": `name`
    llvm: str = ""  # intrinsic without side effect, or the name of a comparison; "": the function of C

    @property
    def is_total(self) -> bool:
        """True if all real numbers have a value."""
        return self.domain == REALS and not self.gaps

    @property
    def in_sympy(self) -> str | Callable[..., Any]:
        """Name in sympy, or a function of the module and the operands."""
        return self.sympy or self.name

    @property
    def in_numpy(self) -> str:
        """Text of the function in a numpy module."""
        return self.numpy or f"np.{self.name}"

    @property
    def in_c(self) -> str:
        """Name of the function, or sign, in C."""
        return self.c or self.name


# ---------------------------------------------------------------- values for numbers


def _sign(x: float) -> float:
    return float((x > 0) - (x < 0))


def _divide(a: float, b: float) -> float:
    if b == 0:
        raise ZeroDivisionError("division by zero")
    return a / b


def _power(a: float, b: float) -> float:
    result = a**b
    if isinstance(result, complex):
        raise ValueError("a negative number has no real power of this exponent")
    return float(result)


def _root(a: float, n: float) -> float:
    """The real n-th root of a."""
    if n == 0 or n % 2 == 0:
        raise ValueError("a power of this exponent has two real inverses, or none")
    if a < 0 and n == int(n):
        return -_power(-a, 1 / n)
    return _power(a, 1 / n)


_NUMPY_ROOT = '''def _root(x, n):
    """The one real number whose power n is x; none for an even n."""
    n = np.asarray(n, dtype=float)
    sign = np.where((n == np.floor(n)) & (n % 2 == 1), np.sign(x), 1.0)
    return np.where(n % 2 == 0, np.nan, sign * np.power(x * sign, 1 / n))[()]
'''


_NUMPY_ERF = '''def _erf(x):
    """The error function, 2/sqrt(pi) times the integral of exp(-t^2) from 0 to x, for numbers and arrays."""
    from math import erf

    return np.vectorize(erf, otypes=[float])(x)[()]
'''


# ---------------------------------------------------------------- the table

_condition = partial(Operator, arity=2, kind="condition", units="", smooth=False, broad=True)
_curve = partial(Operator, arity=0, kind="curve", units="", smooth=False, broad=True)
_slope = partial(Operator, arity=0, kind="slope", units="", smooth=False, broad=True)

_ROWS = (
    # Arithmetic
    Operator("add", lambda *terms: math.fsum(terms), arity=0, units="", broad=True, sympy="Add"),
    Operator("multiply", lambda *factors: math.prod(factors), arity=0, units="", narrow=True, broad=True, sympy="Mul"),
    Operator(
        "divide", _divide, arity=2, units="", sympy=lambda s, a, b: a / b,
        partials=(lambda f, y, a, b: 1.0 / b, lambda f, y, a, b: -(y / b)),
    ),
    Operator("power", _power, arity=2, units="", narrow=True, sympy=lambda s, a, b: a**b, c="pow"),
    Operator("sqrt", math.sqrt, units="root", course="rising", domain=(0.0, math.inf), never_negative=True, narrow=True, llvm="llvm.sqrt.f64",
        partials=(lambda f, y, x: f("select", f("equal", x, 0.0), 0.0, 0.5 / y),),  # of a negative number: none, as the root
        inverse=lambda f, y: f("sqrt", y) ** 4.0,  # y^2, and no number for a negative y
    ),
    Operator("root", _root, arity=2, units="", gaps=True, smooth=False, sympy=lambda s, a, n: a ** (1 / n), numpy="_root", numpy_source=_NUMPY_ROOT,
        partials=(
            lambda f, y, x, n: f("select", f("equal", x, 0.0), 0.0, y / (n * x)),  # infinite at 0 where n > 1, like that of a root of second degree
            lambda f, y, x, n: -((y * f("log", f("abs", x))) / (n * n)),
        ),
    ),
    # Angles
    Operator("sin", math.sin, (lambda f, y, x: f("cos", x),), broad=True, llvm="llvm.sin.f64"),
    Operator("cos", math.cos, (lambda f, y, x: -f("sin", x),), broad=True, llvm="llvm.cos.f64"),
    Operator("tan", math.tan, (lambda f, y, x: 1.0 + y**2.0,), gaps=True),
    Operator("asin", math.asin, (lambda f, y, x: 1.0 / f("sqrt", 1.0 - x * x),), lambda f, y: f("sin", y), course="rising", domain=(-1.0, 1.0),
        numpy="np.arcsin",
    ),
    Operator("acos", math.acos, (lambda f, y, x: -1.0 / f("sqrt", 1.0 - x * x),), course="falling", domain=(-1.0, 1.0), numpy="np.arccos"),
    Operator("atan", math.atan, (lambda f, y, x: 1.0 / (1.0 + x * x),), lambda f, y: f("tan", y), course="rising", narrow=True, numpy="np.arctan"),
    Operator("atan2", math.atan2, arity=2, units="ratio", usage="atan2(y, x)", smooth=False, numpy="np.arctan2",
        partials=(lambda f, y, a, b: b / (a * a + b * b), lambda f, y, a, b: -(a / (a * a + b * b))),
    ),
    # Exponential functions
    Operator("exp", math.exp, (lambda f, y, x: y,), lambda f, y: f("log", y), course="rising", never_negative=True, narrow=True, llvm="llvm.exp.f64"),
    Operator("log", math.log, (lambda f, y, x: 1.0 / x,), lambda f, y: f("exp", y), course="rising", domain=(0.0, math.inf), llvm="llvm.log.f64"),
    Operator("log10", math.log10, (lambda f, y, x: 0.4342944819032518 / x,), lambda f, y: 10.0**y, course="rising", domain=(0.0, math.inf),
        sympy=lambda s, x: s.log(x) / s.log(10),
    ),
    Operator("sinh", math.sinh, (lambda f, y, x: f("cosh", x),), lambda f, y: f("asinh", y), course="rising"),
    Operator("cosh", math.cosh, (lambda f, y, x: f("sinh", x),), never_negative=True, narrow=True),
    Operator("tanh", math.tanh, (lambda f, y, x: 1.0 - y * y,), lambda f, y: f("atanh", y), course="rising", narrow=True),
    Operator("asinh", math.asinh, (lambda f, y, x: 1.0 / f("sqrt", x * x + 1.0),), lambda f, y: f("sinh", y), course="rising", narrow=True, numpy="np.arcsinh"),
    Operator("acosh", math.acosh, (lambda f, y, x: 1.0 / f("sqrt", x * x - 1.0),), course="rising", domain=(1.0, math.inf), numpy="np.arccosh"),
    Operator("atanh", math.atanh, (lambda f, y, x: 1.0 / (1.0 - x * x),), lambda f, y: f("tanh", y), course="rising", domain=(-1.0, 1.0), numpy="np.arctanh"),
    Operator("erf", math.erf, (lambda f, y, x: 1.1283791670955126 * f("exp", -(x * x)),), course="rising", narrow=True,
        numpy="_erf", numpy_source=_NUMPY_ERF,
    ),
    # Kinks and jumps. Derivatives are one-sided, from the right.
    Operator("abs", abs, (lambda f, y, x: f("select", f("less", x, 0.0), -1.0, 1.0),), units="same", never_negative=True, smooth=False, broad=True,
        sympy="Abs", c="fabs", llvm="llvm.fabs.f64",
    ),
    Operator("sign", _sign, (lambda f, y, x: 0.0,), units="ratio", course="jumping", smooth=False, broad=True),
    Operator("floor", lambda x: float(math.floor(x)), (lambda f, y, x: 0.0,), course="jumping", smooth=False, broad=True, llvm="llvm.floor.f64"),
    Operator("ceil", lambda x: float(math.ceil(x)), (lambda f, y, x: 0.0,), course="jumping", smooth=False, broad=True, sympy="ceiling", llvm="llvm.ceil.f64"),
    Operator("min", min, arity=2, units="same", usage="min(a, b)", smooth=False, broad=True, sympy="Min", numpy="np.minimum", c="lesser",
        partials=(lambda f, y, a, b: f("select", f("less", a, b), 1.0, 0.0), lambda f, y, a, b: f("select", f("less", a, b), 0.0, 1.0)),
    ),
    Operator("max", max, arity=2, units="same", usage="max(a, b)", smooth=False, broad=True, sympy="Max", numpy="np.maximum", c="greatest",
        partials=(lambda f, y, a, b: f("select", f("less", b, a), 1.0, 0.0), lambda f, y, a, b: f("select", f("less", b, a), 0.0, 1.0)),
    ),
    # Conditions and choices
    _condition("less", lambda a, b: a < b, arity=2, sympy="Lt", c="<", llvm="olt"),
    _condition("less_equal", lambda a, b: a <= b, arity=2, sympy="Le", c="<=", llvm="ole"),
    _condition("equal", lambda a, b: a == b, arity=2, sympy="Eq", c="==", llvm="oeq"),
    _condition("and", lambda a, b: bool(a) and bool(b), arity=2, sympy="And", numpy="np.logical_and", c="&&"),
    _condition("or", lambda a, b: bool(a) or bool(b), arity=2, sympy="Or", numpy="np.logical_or", c="||"),
    _condition("not", lambda a: not a, arity=1, sympy="Not", numpy="np.logical_not", c="!"),
    Operator("select", lambda c, a, b: a if c else b, arity=3, units="", smooth=False, broad=True, numpy="_select", c="chosen",
        sympy=lambda s, c, a, b: s.Piecewise((a, c), (b, True)),
    ),
    # Curves through points, any number of them, and random numbers. The first operand is the order of the derivative, the second is the
    # argument; the other operands are constant during a run (see `table.py`).
    _curve("linear", partial(interpolate.value_on, interpolate.linear, 2), numpy="_linear"),
    _curve("cubic", partial(interpolate.value_on, interpolate.hermite, 3), numpy="_hermite"),
    _curve("monotone", partial(interpolate.value_on, interpolate.hermite, 3), numpy="_hermite"),
    _curve("inverse", partial(interpolate.value_on, interpolate.inverse, 3), numpy="_inverse"),
    _curve("noise", interpolate.noise_at, numpy="_noise"),
    # Number, places, values -> the slope of a curve in one of its points.
    _slope("natural_slope", partial(interpolate.slope_at, interpolate.natural_slopes), numpy="_natural_slope"),
    _slope("monotone_slope", partial(interpolate.slope_at, interpolate.monotone_slopes), numpy="_monotone_slope"),
)  # fmt: skip

OPERATORS: Mapping[str, Operator] = {row.name: row for row in _ROWS}
CONDITIONS = frozenset(row.name for row in _ROWS if row.kind == "condition")
CURVES = frozenset(row.name for row in _ROWS if row.kind == "curve")
SLOPES = frozenset(row.name for row in _ROWS if row.kind == "slope")


def value_of(operator: str, values: Iterable[float]) -> float:
    """Value of an operator for floats. Raises ArithmeticError or ValueError if it has no finite real value."""
    return float(OPERATORS[operator].value(*values))
