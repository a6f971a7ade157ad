"""Common parts of the analysis commands: their arguments, and their output."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from .error_reporting import problems_told
from .options import (
    analysed_option,
    check_target,
    echo,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    settings_by_name,
    settings_option,
)

if TYPE_CHECKING:
    from .. import Model

PICTURES = (".png", ".svg", ".pdf")

Command = Callable[..., None]
Write = Callable[[str], Any]


@dataclass(frozen=True, slots=True)
class AnalysisCall:
    """A model's file, and the options of its analysis."""

    file: str
    name: str | None  # name of the model, if the file has several
    experiment: str | None
    settings: Mapping[str, str]
    outputs: tuple[str, ...] | None  # None: all
    as_json: bool

    @property
    def model(self) -> Model:
        """Read the model again and return it."""
        return load(self.file, self.name)

    def answer(self, found: Any) -> None:
        """Print a result."""
        echo(found, self.as_json)


def analysis(name: str, of_outputs: bool = True) -> Callable[[Command], click.Command]:
    """Return a command with a file, `-e`, `--set`, `--output` (if `of_outputs`), `--json`, `--model`, and its own options, which come first in its help.

    It is called with `Asked` and its own options; its errors are reported.
    """

    def decorate(function: Command) -> click.Command:
        @wraps(function)
        def command(
            file: str, experiment: str, settings: Sequence[str], as_json: bool, model: str | None, outputs: Sequence[str] = (), **own: Any
        ) -> None:  # fmt: skip
            with problems_told():
                given = settings_by_name(settings)
                function(AnalysisCall(file, model, named(experiment), given, tuple(outputs) or None, as_json), **own)

        own = vars(command).pop("__click_params__", [])
        shared = [analysed_option, settings_option, json_option, model_option]
        for option in reversed([outputs_option, *shared] if of_outputs else shared):
            option(command)
        vars(command)["__click_params__"] += own
        return click.command(name)(file_argument(command))

    return decorate


def picture_option(metavar: str, words: str) -> Callable[[Command], Command]:
    """Return the option `--plot`, which draws the result."""
    return click.option("--plot", metavar=metavar, help=f"{words} (.png, .svg or .pdf).")


def check_targets(*targets: tuple[str | None, tuple[str, ...], str]) -> None:
    """Check before any computation that files can be written: paths, their endings, the options that name them."""
    for path, endings, option in targets:
        if path is not None:
            check_target(path, endings, option)


def write_all(*targets: tuple[str | None, Write]) -> None:
    """Write the requested files."""
    for path, write in targets:
        if path is not None:
            write(path)


def bounds(text: str, option: str, example: str) -> tuple[str, str]:
    """Return both ends of `LOW .. HIGH`."""
    low, dots, high = text.partition("..")
    if not dots:
        raise click.UsageError(f"{option} takes {example}; this is `{text}`")
    return low, high


over_option = click.option(
    "--over", metavar='"LOW .. HIGH"', help="Frequencies, as `100 Hz .. 10 kHz`; a decade around the modes if left out."
)


def frequencies_of(over: str | None) -> tuple[float | None, float | None]:
    """Return both ends in Hz; None where the model decides."""
    if over is None:
        return None, None
    from ..quantities import quantity

    low, high = bounds(over, "--over", "a range, as in `100 Hz .. 10 kHz`")
    return quantity(low, "Hz", "--over"), quantity(high, "Hz", "--over")
