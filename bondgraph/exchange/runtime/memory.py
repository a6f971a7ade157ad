"""Memory of an instance: a copy of the unit's image, whose addresses within itself are made those of the copy."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compiler.api import Ints


def place_inside(block: Ints, address: int, image: Ints, inside: Ints, count: int) -> None:
    """Put the addresses within a block of memory: the image has them as if the block began at 0."""
    for k in range(count):
        block[inside[k]] = image[inside[k]] + address
