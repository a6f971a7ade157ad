"""Common parts of the analysis commands: their arguments, and their output."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import TYPE_CHECKING, Any

import click

from .error_reporting import problems_told
from .options import (
    Command,
    OutputFiles,
    echo,
    echo_readings,
    experiment_option,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    outputs_option,
    settings_by_name,
    settings_option,
    taken,
)

if TYPE_CHECKING:
    from .. import Model
    from ..keywords import ExperimentKeywords


@dataclass(frozen=True)
class AnalysisCall:
    """A model's file, and the options of its analysis."""

    file: str
    name: str | None  # name of the model, if the file has several
    experiment: str | None
    settings: Mapping[str, str]
    outputs: tuple[str, ...] | None  # None: all
    files: OutputFiles

    @cached_property
    def model(self) -> Model:
        """The model of the file."""
        return load(self.file, self.name)

    @property
    def keywords(self) -> ExperimentKeywords:
        """Experiment and settings as keywords of an analysis."""
        return {"experiment": self.experiment, "settings": self.settings}

    def answer(self, found: Any) -> None:
        """Write the files of a result, and print it."""
        files = self.files
        writers = ((files.plot, "plot"), (files.tornado, "plot_tornado"), (files.curves, "plot_curves"))
        for path, write in writers:
            if path is not None:
                getattr(found, write)(path)
        if not files.write(found):
            self.print(found)

    def print(self, found: Any) -> None:
        """Print a result."""
        echo(found, self.files.as_json)


def analysis(name: str, of_outputs: bool = True, checked: bool = True) -> Callable[[Command], click.Command]:
    """Return a command with a file, `-e`, `--set`, `--output` (if `of_outputs`), `--json`, `--model`, and its own options, which come first in its help.

    It is called with an `AnalysisCall`, whose files can be written (if `checked`), and its own options; its errors are reported.
    """

    def decorate(function: Command) -> click.Command:
        @wraps(function)
        def command(
            file: str, experiment: str, settings: Sequence[str], model: str | None, outputs: Sequence[str] = (), **own: Any
        ) -> None:  # fmt: skip
            with problems_told():
                assignments, files = settings_by_name(settings), taken(OutputFiles, own)
                if checked:
                    files.check()
                call = AnalysisCall(file, model, named(experiment), assignments, tuple(outputs) or None, files)
                echo_readings(call.model, call.experiment, assignments)
                function(call, **own)

        own = vars(command).pop("__click_params__", [])
        shared = [experiment_option, settings_option, json_option, model_option]
        for option in reversed([outputs_option, *shared] if of_outputs else shared):
            option(command)
        vars(command)["__click_params__"] += own
        return click.command(name)(file_argument(command))

    return decorate


def picture_option(metavar: str, words: str) -> Callable[[Command], Command]:
    """Return the option `--plot`, which draws the result."""
    return click.option("--plot", metavar=metavar, help=f"{words} (.png, .svg or .pdf).")


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
