"""Python's cyclic garbage collector, paused during work whose results all stay alive."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

FEW = 100_000  # new objects, which are soon walked through


@contextmanager
def uncollected() -> Iterator[None]:
    """Pause the collection of cycles.

    Trees, scopes and graphs live until a stage is done and have few cycles, but each collection walks through all of them:
    on a file of a megabyte that was half of the time, and more than linear in it. Objects without cycles are freed as usual.

    The collection that would follow walks through all new objects once more, an eighth of the time of a large model. If most objects are new, they are made
    old instead, which takes no time, and wait for a full collection. Of many models in a row that is the first only, so what waits stays little.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            if gc.get_count()[0] > max(FEW, len(gc.get_objects(generation=2))) and not gc.get_freeze_count():
                gc.freeze()
                gc.unfreeze()
            gc.enable()
