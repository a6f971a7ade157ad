"""A program from its image: functions of arrays at the addresses of its object code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...jit.machine import MachineCode
from ..program import HYBRID, Native, Program, hybrid_of
from .evaluate import dense, functions, hand_over, mode_at
from .program_image import ProgramImage


def bind(described: ProgramImage, codes: Sequence[bytes]) -> Program:
    """Program from its data and object code."""
    machine = MachineCode(*codes)
    names = described.names
    for rows in described.rows:
        hand_over(machine, rows)
    native = Native(machine.addresses(name for name, _, _ in described.functions), machine)
    found = functions(described.functions, native.addresses, machine)
    pattern, slopes, held = (
        tuple(np.array(part, dtype=int) for part in pair)
        for pair in (described.pattern, described.sensitivity_pattern, described.invariant_pattern)
    )
    multipliers, rates, parts, eliminated = described.of_invariants
    count = len(names["STATES"].names) + len(names["UNKNOWNS"].names)
    given: dict[str, Any] = {
        "name": described.name, "source": described.source, "states": names["STATES"], "unknowns": names["UNKNOWNS"],
        "outputs": names["OUTPUTS"], "inputs": names["INPUTS"], "parameters": names["PARAMETERS"], "dependents": names["DEPENDENTS"],
        "defaults": described.defaults, "input_defaults": described.input_defaults, "pattern": pattern, "sensitivity_pattern": slopes,
        "jacobian": dense(found["jacobian_entries"], pattern, count), "limits": described.limits,
        "invariants": names["INVARIANTS"], "invariant_pattern": held,
        "multipliers": multipliers, "rates": rates, "parts": parts, "eliminated": eliminated, "solved": None,
        "operations": described.operations, "differentiated": described.differentiated, "native": native,
        "time_functions": described.time_functions,
    }  # fmt: skip
    note = described.hybrid
    if note is not None:
        found["mode_at"] = mode_at(note, found)
        given["hybrid"] = hybrid_of(note, found)
    named = Program.__dataclass_fields__.keys() - set(HYBRID)
    given |= {name: function for name, function in found.items() if name in named} | {"functions": found}
    return Program(**given)
