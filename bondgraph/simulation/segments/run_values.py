"""Values of a run that its parameters decide, with answers that have been found for them: another run with the same parameters need not search again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from compiler.api import Array, Program

from ...memo import keep

MOST = 8  # sets of parameters of a program whose answers are cached
ANSWERS = 16  # answers of each kind for one of them
LARGEST = 64  # most parts of an answer, such as segments with their signals


@dataclass(frozen=True, slots=True, eq=False)
class RunValues:
    """Parameters, inputs and constants of a program, shapes (P,), (U,), (K,). All runs with them share the arrays, so nobody writes into them."""

    parameters: Any
    inputs: Any
    constants: Any
    answers: dict[str, dict[object, Any]] = field(default_factory=dict)

    def recall(self, kind: str, key: object, find: Callable[[], Any], size: Callable[[Any], int]) -> Any:
        """Return the answer of a kind for a key, which nobody changes; found at its first use. It depends on these values and the key alone.

        One of a `size` above `LARGEST` is not kept.
        """
        answers = self.answers.setdefault(kind, {})
        answer = answers.get(key)
        if answer is None:
            answer = find()
            if size(answer) <= LARGEST:
                keep(answers, key, answer, ANSWERS)
        return answer


def run_values(program: Program, parameters: Array) -> RunValues:
    """Return the values of a run of a program, those of an earlier run with the same parameters if they are cached."""
    cache, key = program.kept.setdefault("run values", {}), parameters.tobytes()
    values: RunValues | None = cache.get(key)
    if values is None:
        values = RunValues(parameters, np.array(program.input_defaults, dtype=float), program.constants(parameters))
        keep(cache, key, values, MOST)
    return values
