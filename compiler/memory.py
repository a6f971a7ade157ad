"""Python's cyclic garbage collector, kept away from work that only makes what stays."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """No collection of cycles within.

    Trees, scopes and graphs live until a stage is done and hold few cycles, but each collection walks through all of them:
    on a file of a megabyte that was half of the time, and more than linear in it. What is no cycle is freed as ever.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
