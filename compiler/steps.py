"""Analysis steps of an experiment, one row each: the word, what the grammar lets follow it, and its attributes in braces.

The grammar, the reading of a step's attributes, its part in a Monte Carlo study and the colours of a page are read from here.
"""

from __future__ import annotations

from .fast_dataclass import dataclass

_MOST = 200_000


@dataclass(frozen=True, slots=True)
class AnalysisStep:
    """An analysis step of an experiment.

    `grammar`: what follows the word, in the notation of `grammar.lark`. Attributes: `counts` are whole numbers with a lowest and a highest value,
    `truths` are true or false, `named` belong to a name, as `limit u = 3 V`. `scalar`: numbers at each point, so that `montecarlo` can repeat it.
    """

    word: str
    grammar: str = "[attributes]"
    counts: tuple[tuple[str, int, int], ...] = ()
    truths: tuple[str, ...] = ()
    named: tuple[str, ...] = ()
    scalar: bool = False


_ROWS = (
    AnalysisStep("equilibrium", scalar=True),
    AnalysisStep("modes", scalar=True),
    AnalysisStep("bode", counts=(("points", 2, 1_000_000),)),
    AnalysisStep("response", 'one "to" one "over" range [attributes]', (("points", 2, 1_000_000),)),
    AnalysisStep("linearize", '[listed "to" listed]'),
    AnalysisStep("sensitivity", "[listed]"),
    AnalysisStep("continue", 'one "over" range [attributes]', (("points", 2, _MOST), ("most", 2, _MOST)), ("branches",)),
    AnalysisStep("invert", 'drives "to" wishes ["over" range] [attributes]', (("points", 2, _MOST),), ("moving",), ("limit",)),
    AnalysisStep("montecarlo", "chances [attributes]", (("samples", 2, 10_000_000), ("seed", 0, 2**31 - 1), ("indices", 0, 10_000_000))),
    AnalysisStep("fit", 'unknowns "to" text ("," text)* [attributes]', truths=("explain",), named=("scale",)),
)  # fmt: skip
ANALYSIS_STEPS = {row.word: row for row in _ROWS}
