"""`%%bg NAME` in a notebook: the text of a cell becomes a model; `%load_ext bondgraph` brings it."""

from __future__ import annotations

from functools import partial
from keyword import iskeyword
from typing import TYPE_CHECKING

from ..errors import UsageError
from . import Model, load

if TYPE_CHECKING:
    from IPython.core.interactiveshell import InteractiveShell


def load_ipython_extension(shell: InteractiveShell) -> None:
    """Give a notebook the magic `%%bg`."""
    shell.register_magic_function(partial(model_of_cell, shell), "cell", "bg")


def model_of_cell(shell: InteractiveShell, line: str, cell: str) -> Model:
    """Return the model of a cell, which then has a name: the word behind `%%bg`, else `model`. It shows its graph, or all its errors.

    Raises `UsageError` where that word cannot be a name.
    """
    name = line.strip() or "model"
    if not name.isidentifier() or iskeyword(name):
        raise UsageError(
            "BR651", f"`{name}` cannot be a name in Python:", "write `%%bg` and a word, such as `%%bg car`"
        )
    model = load(f"{cell}\n")
    shell.user_ns[name] = model
    return model
