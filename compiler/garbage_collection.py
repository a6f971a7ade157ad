"""Python's cyclic garbage collector, paused during work whose results all stay alive."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Pause the collection of cycles.

    Trees, scopes and graphs live until a stage is done and have few cycles, but each collection walks through all of them:
    on a file of a megabyte that was half of the time, and more than linear in it. Objects without cycles are freed as usual.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
