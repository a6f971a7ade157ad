"""Noun of this folder: a kind of program that is a text for others."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ...fast_dataclass import dataclass
from ...reduction import StateSpace


@dataclass(frozen=True, slots=True)
class TextTarget:
    """A target: its name, the ending of its files, and its writer, from a state space and the author's descriptions of quantities.

    Of several targets with one ending, the `usual` one is written where none is named.
    """

    name: str
    ending: str
    write: Callable[[StateSpace, Mapping[str, str]], str]
    usual: bool = True
