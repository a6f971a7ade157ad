"""Addresses of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from compiler.jit.machine import address_of

PLAIN = np.arange(12.0).reshape(3, 4)
READ_ONLY = np.arange(3)
READ_ONLY.flags.writeable = False
ARRAYS = {
    "plain": PLAIN,
    "whole numbers": np.arange(3),
    "a part": PLAIN[1:],
    "with gaps": PLAIN[:, 2],
    "turned": PLAIN.T,
    "backwards": PLAIN[0, ::-1],
    "read only": READ_ONLY,
    "of bytes": np.frombuffer(b"12345678"),
    "nothing": np.zeros(0),
    "no rows": PLAIN[3:],
    "one number": np.array(2.0),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_as_numpy_says(kind: str) -> None:
    array: Any = ARRAYS[kind]
    assert address_of(array) == array.__array_interface__["data"][0]


def test_what_is_asked_for_can_grow_again() -> None:
    """Nothing holds on to the array: a buffer that is looked at cannot be resized."""
    array: Any = np.arange(3.0)
    address_of(array)
    array.resize(5, refcheck=False)
    assert list(array) == [0, 1, 2, 0, 0]
