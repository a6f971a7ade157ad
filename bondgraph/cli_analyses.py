"""The commands that analyse a model: `bondgraph equilibrium|linearize|modes|bode|sensitivity|sweep|continue|invert|reproduce`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import click

from .cli import FAILED, _check_target, _file, _load, _model, _outputs, _setting, _told, _workers, commands

_experiment = click.option(
    "-e", "--experiment", default="none", metavar="NAME", help="With what this experiment sets and starts; none if left out."
)  # fmt: skip
_settings = click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", help="Set a parameter (`a=171 um`) or an input."
)
_json = click.option("--json", "as_json", is_flag=True, help="Print it as JSON, in SI and Hz.")
_inputs = click.option(
    "--input", "inputs", multiple=True, metavar="NAME", help="From this input, parameter or signal (several times: these)."
)  # fmt: skip
_state = click.option(
    "--at", "state", default="equilibrium", type=click.Choice(["equilibrium", "start"]), help="At rest, or at the start."
)  # fmt: skip
_time = click.option(
    "--time", "time", metavar="TIME", help="Inputs as they are then; where the experiment begins if left out."
)


def _named(experiment: str) -> str | None:
    return None if experiment == "none" else experiment


def _seconds(time: str | None) -> float | None:
    if time is None:
        return None
    from .simulation.run import seconds

    return seconds(time)


def _echo(found: Any, as_json: bool) -> None:
    click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.summary())


@commands.command()
@_file
@_experiment
@_outputs
@_settings
@_time
@_json
@_model
def equilibrium(
    file: str, experiment: str, outputs: Sequence[str], settings: Sequence[str], time: str | None, as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Find the state of rest that is reached from the start, and whether it is stable."""
    with _told():
        chosen = _load(file, model)
        found = chosen.equilibrium(
            _named(experiment), dict(map(_setting, settings)), tuple(outputs) or None, _seconds(time)
        )
        _echo(found, as_json)


@commands.command()
@_file
@_inputs
@_outputs
@_state
@_experiment
@_settings
@_time
@_json
@_model
def linearize(
    file: str, inputs: Sequence[str], outputs: Sequence[str], state: str, experiment: str, settings: Sequence[str],
    time: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Print A, B, C, D of the linear model at rest or at the start."""
    with _told():
        found = _load(file, model).linearize(
            tuple(inputs) or None, tuple(outputs) or None, _named(experiment), dict(map(_setting, settings)), state, _seconds(time)
        )  # fmt: skip
        _echo(found, as_json)


@commands.command()
@_file
@_state
@_experiment
@_settings
@_time
@_json
@_model
def modes(
    file: str, state: str, experiment: str, settings: Sequence[str], time: str | None, as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Print frequencies, damping, and where the energy of each mode is."""
    with _told():
        found = _load(file, model).modes(_named(experiment), dict(map(_setting, settings)), state, _seconds(time))
        _echo(found, as_json)


@commands.command()
@_file
@_inputs
@_outputs
@click.option(
    "--over", metavar='"LOW .. HIGH"', help="Frequencies, as `100 Hz .. 10 kHz`; a decade around the modes if left out."
)
@click.option("--points", default=400, metavar="N", help="How many frequencies, besides those of resonances (400).")
@_state
@_experiment
@_settings
@_time
@click.option("--plot", metavar="B.png", help="Draw magnitude and phase (.png, .svg or .pdf).")
@_json
@_model
def bode(
    file: str, inputs: Sequence[str], outputs: Sequence[str], over: str | None, points: int, state: str, experiment: str,
    settings: Sequence[str], time: str | None, plot: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Print the frequency response of the linear model at rest or at the start."""
    with _told():
        if plot is not None:
            _check_target(plot, (".png", ".svg", ".pdf"), "--plot")
        low, high = (None, None) if over is None else _range(over)
        found = _load(file, model).response(
            tuple(inputs) or None, tuple(outputs) or None, low, high, points, _named(experiment),
            dict(map(_setting, settings)), state, _seconds(time),
        )  # fmt: skip
        if plot is not None:
            found.plot(plot)
        _echo(found, as_json)


def _range(text: str) -> tuple[float, float]:
    from .quantities import quantity

    low, dots, high = text.partition("..")
    if not dots:
        raise click.UsageError(f"--over takes a range, as in `100 Hz .. 10 kHz`; this is `{text}`")
    return quantity(low, "Hz", "--over"), quantity(high, "Hz", "--over")


@commands.command()
@_file
@click.option(
    "--by",
    "by",
    multiple=True,
    metavar="NAME",
    help="By this parameter or input (several times: these); all parameters if left out.",
)
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes"]), help="Of what; both if left out."
)
@_outputs
@_experiment
@_settings
@_time
@_json
@_model
def sensitivity(
    file: str, by: Sequence[str], of: Sequence[str], outputs: Sequence[str], experiment: str, settings: Sequence[str],
    time: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Tell how outputs at rest, frequencies and damping move with parameters: exact derivatives."""
    with _told():
        found = _load(file, model).sensitivity(
            tuple(by) or None, tuple(of) or ("equilibrium", "modes"), _named(experiment), dict(map(_setting, settings)),
            tuple(outputs) or None, _seconds(time),
        )  # fmt: skip
        _echo(found, as_json)


@commands.command()
@_file
@click.option(
    "--over", "over", multiple=True, required=True, metavar='"NAME=V, V…"',
    help="Values of a parameter or input: `k=1 N/m, 2 N/m`, or `k=1 N/m .. 2 N/m : 11`; several times: a grid.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate"]), help="What is made at each point (simulate)."
)  # fmt: skip
@click.option("--together", is_flag=True, help="No grid: the first values of all, the second ones and so on.")
@_outputs
@_experiment
@_settings
@click.option("--to", metavar="TIME", help="Where simulations end.")
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="N", help="How many processes make the points (1).")
@click.option("--out", metavar="S.csv", help="Write the table.")
@click.option("--plot", metavar="S.png", help="Draw what was found over what was swept last (.png, .svg or .pdf).")
@_json
@_model
def sweep(
    file: str, over: Sequence[str], of: Sequence[str], together: bool, outputs: Sequence[str], experiment: str, settings: Sequence[str],
    to: str | None, jobs: int | None, out: str | None, plot: str | None, as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Make equilibria, modes or runs at many values of parameters and inputs."""
    with _told():
        for path, endings, option in ((out, (".csv",), "--out"), (plot, (".png", ".svg", ".pdf"), "--plot")):
            if path is not None:
                _check_target(path, endings, option)
        values = dict(map(_setting, over))
        with _workers(jobs) as executor:
            found = _load(file, model).sweep(
                values, tuple(of) or "simulate", together, _named(experiment), dict(map(_setting, settings)), to,
                outputs=tuple(outputs) or None, executor=executor,
            )  # fmt: skip
        if out is not None:
            found.to_csv(out)
        if plot is not None:
            found.plot(plot)
        _echo(found, as_json)


@commands.command(name="continue")
@_file
@click.option(
    "--along", required=True, metavar='"NAME=A .. B"', help="The parameter or input, and between which values."
)
@click.option("--points", type=click.IntRange(2), default=50, metavar="N", help="The range over the first step (50).")
@click.option("--most", type=click.IntRange(2), default=2000, metavar="N", help="Points after which it ends (2000).")
@_outputs
@_experiment
@_settings
@_json
@_model
def continue_(
    file: str, along: str, points: int, most: int, outputs: Sequence[str], experiment: str, settings: Sequence[str], as_json: bool,
    model: str | None,
) -> None:  # fmt: skip
    """Follow a branch of states of rest against a parameter, round its folds: pull-in, snap-through, buckling."""
    with _told():
        name, value = _setting(along)
        low, dots, high = value.partition("..")
        if not dots:
            raise click.UsageError(f"--along takes `NAME = A .. B`; this is `{along}`")
        found = _load(file, model).continuation(
            name, low, high, points, most, _named(experiment), dict(map(_setting, settings)), tuple(outputs) or None
        )
        _echo(found, as_json)


@commands.command()
@_file
@click.option(
    "--want", "targets", multiple=True, required=True, metavar="OUTPUT=VALUE", help="An output at rest: `x=8 um`."
)
@click.option(
    "--by",
    "inputs",
    multiple=True,
    required=True,
    metavar="INPUT|PUSH/PULL",
    help="An input to find, or two of which one is zero.",
)
@_experiment
@_settings
@_json
@_model
def invert(
    file: str, targets: Sequence[str], inputs: Sequence[str], experiment: str, settings: Sequence[str], as_json: bool, model: str | None
) -> None:  # fmt: skip
    """Find inputs that hold outputs at given values, at rest."""
    with _told():
        found = _load(file, model).invert(
            dict(map(_setting, targets)), inputs, _named(experiment), dict(map(_setting, settings))
        )  # fmt: skip
        _echo(found, as_json)


@commands.command()
@click.argument("folder", metavar="FOLDER")
@click.option("--page", metavar="PAGE.md", help="Write the comparison as a page.")
@_json
def reproduce(folder: str, page: str | None, as_json: bool) -> None:
    """Compute again what a folder's `published.toml` lists, and say how well it agrees with print; exit 3 if something does not."""
    with _told():
        from .files import write_text
        from .reproduction import reproduce as reproduced

        if page is not None:
            _check_target(page, (".md",), "--page")
        found = reproduced(folder)
        if page is not None:
            write_text(page, found.page())
        _echo(found, as_json)
        if not found.agrees:
            raise click.exceptions.Exit(FAILED)
