"""Progress bar on the terminal. It uses no thread, as a process with threads cannot be copied."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .point_request import Progress


@contextmanager
def bar(words: str) -> Iterator[Progress | None]:
    """Yield a function that shows the number of finished points; None if the error stream is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False) as shown:
        task = shown.add_task(words, total=None)

        def told(done: int, total: int) -> None:
            shown.update(task, completed=done, total=total)
            shown.refresh()

        yield told
