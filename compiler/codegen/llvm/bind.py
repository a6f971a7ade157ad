"""A program from its image: functions of arrays at the addresses of its object code."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...jit.machine import MachineCode
from ..program import Native, Program
from ..program_image import ProgramImage, program_of
from .evaluate import dense, functions, hand_over, mode_at


def bind(image: ProgramImage, codes: Sequence[bytes]) -> Program:
    """Program from its data and object code."""
    machine = MachineCode(*codes)
    for rows in image.rows:
        hand_over(machine, rows)
    native = Native(machine.addresses(name for name, _, _ in image.functions), machine)
    found = functions(image.functions, native.addresses, machine)
    count = len(image.names["STATES"].names) + len(image.names["UNKNOWNS"].names)
    pattern = tuple(np.array(part, dtype=int) for part in image.pattern)
    found["jacobian"] = dense(found["jacobian_entries"], pattern, count)
    if image.hybrid is not None:
        found["mode_at"] = mode_at(image.hybrid, found)
    return program_of(image, found, native)
