"""Commands of analyses, in the order of the help: rest, branches, linear models, modes, responses, sensitivities, inputs for outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from ..keywords import AnalysisKeywords, PointKeywords
from . import completion
from .analysis import AnalysisCall, analysis, bounds, frequencies_of, over_option, picture_option
from .options import (
    PICTURES,
    TABLES,
    check_targets,
    inputs_option,
    seconds_of,
    setting,
    settings_by_name,
    state_option,
    time_option,
)  # fmt: skip


@analysis("equilibrium")
@time_option
def equilibrium(asked: AnalysisCall, time: str | None) -> None:
    """Find the state of rest that is reached from the start, and whether it is stable."""
    asked.answer(asked.model.equilibrium(asked.experiment, asked.settings, asked.outputs, seconds_of(time)))


@analysis("continue")
@click.option(
    "--along",
    required=True,
    metavar='"NAME=A .. B"',
    shell_complete=completion.settings,
    help="The parameter or input, and between which values.",
)
@click.option("--points", type=click.IntRange(2), default=50, metavar="N", help="The range over the first step (50).")
@click.option("--most", type=click.IntRange(2), default=2000, metavar="N", help="Points after which it ends (2000).")
@click.option("--branch", "branches", is_flag=True, help="Follow the branches that cross it, too.")
@picture_option("B.png", "Draw the branch over the parameter")
def continue_(asked: AnalysisCall, along: str, points: int, most: int, branches: bool) -> None:
    """Follow a branch of states of rest against a parameter, round its folds: pull-in, snap-through, buckling."""
    name, value = setting(along, "--along", "k=1 N/m .. 2 N/m")
    low, high = bounds(value, "--along", "`NAME = A .. B`")
    found = asked.model.continuation(name, low, high, points, most, asked.outputs, branches, **asked.keywords)
    asked.answer(found)


@analysis("linearize")
@inputs_option
@state_option
@time_option
def linearize(asked: AnalysisCall, inputs: Sequence[str], state: str, time: str | None) -> None:
    """Print A, B, C, D of the linear model at rest or at the start."""
    options: PointKeywords = {"state": state, "time": seconds_of(time), **asked.keywords}
    asked.answer(asked.model.linearize(tuple(inputs) or None, asked.outputs, **options))


@analysis("modes")
@state_option
@picture_option("M.svg", "Draw the shapes on the mechanism, rest behind them")
@click.option("--mechanism", metavar="NAME", help="Of this mechanism, if there are several.")
@click.option("--shapes", type=click.IntRange(1, 60), default=6, metavar="N", help="How many shapes are drawn (6).")
@time_option
def modes(asked: AnalysisCall, state: str, mechanism: str | None, shapes: int, time: str | None) -> None:
    """Print frequencies, damping, and where the energy of each mode is; draw their shapes."""
    model, plot = asked.model, asked.files.plot
    if plot is not None:
        if asked.settings or asked.outputs or state != "equilibrium" or time is not None:
            raise click.UsageError("--plot draws all modes at rest: set in an experiment what is to be set")
        model.draw_mechanism(plot, mechanism, asked.experiment, modes=shapes)
    asked.print(model.modes(asked.experiment, asked.settings, state, seconds_of(time), asked.outputs))


@analysis("bode")
@inputs_option
@over_option
@click.option("--points", default=400, metavar="N", help="How many frequencies, besides those of resonances (400).")
@state_option
@time_option
@picture_option("B.png", "Draw magnitude and phase")
def bode(
    asked: AnalysisCall, inputs: Sequence[str], over: str | None, points: int, state: str, time: str | None
) -> None:
    """Print the frequency response of the linear model at rest or at the start."""
    low, high = frequencies_of(over)
    found = asked.model.response(
        tuple(inputs) or None, asked.outputs, low, high, points, state=state, time=seconds_of(time), **asked.keywords
    )  # fmt: skip
    asked.answer(found)


@analysis("sensitivity")
@click.option(
    "--by", "by", multiple=True, metavar="NAME", shell_complete=completion.parameters,
    help="By this parameter or input (several times: these); all parameters if left out.",
)  # fmt: skip
@click.option(
    "--of", "of", multiple=True, type=click.Choice(["equilibrium", "modes", "simulate", "linearize", "response"]),
    help="Of what; rest and modes if left out; `simulate`: of a run, at every instant; `linearize`: of A, B, C, D; `response`: of a frequency response.",
)  # fmt: skip
@inputs_option
@over_option
@time_option
@click.option("--to", metavar="TIME", help="Where the run ends.")
@click.option(
    "--points", type=click.IntRange(2), default=101, metavar="N", help="Instants of the run, or frequencies (101)."
)
def sensitivity(
    asked: AnalysisCall, by: Sequence[str], of: Sequence[str], inputs: Sequence[str], over: str | None, time: str | None, **run: Any
) -> None:  # fmt: skip
    """Tell how rest, frequencies and damping, a run, A, B, C, D or a frequency response move with parameters: exact derivatives."""
    alone = [what for what in of if what not in ("equilibrium", "modes")]
    if alone and len(of) > 1:
        raise click.UsageError(f"--of {alone[0]} stands alone")
    model, names, input_names = asked.model, tuple(by) or None, tuple(inputs) or None
    options: AnalysisKeywords = {"time": seconds_of(time), **asked.keywords}
    if alone == ["simulate"]:
        found: Any = model.sensitivity_of_run(names, outputs=asked.outputs, **asked.keywords, **run)
    elif alone == ["linearize"]:
        found = model.sensitivity_of_linearization(names, input_names, asked.outputs, **options)
    elif alone:
        low, high = frequencies_of(over)
        found = model.sensitivity_of_response(names, input_names, asked.outputs, low, high, run["points"], **options)
    else:
        found = model.sensitivity(names, tuple(of) or ("equilibrium", "modes"), asked.outputs, **options)
    asked.answer(found)


@analysis("invert", of_outputs=False, checked=False)
@click.option(
    "--want", "targets", multiple=True, metavar="OUTPUT=VALUE", shell_complete=completion.targets,
    help="An output at rest, `x=8 um`; with --to along a path, `x=8 um*smoothstep9(time, 0 s, 5 ms)`.",
)  # fmt: skip
@click.option(
    "--setpoints", metavar="S.csv",
    help="Outputs from a file: `x [um],phi [deg]`, each line held at rest; with a column `time [s]` a path through its lines.",
)  # fmt: skip
@click.option(
    "--by", "inputs", multiple=True, required=True, metavar="INPUT|PUSH/PULL", shell_complete=completion.inputs,
    help="An input to find, or two of which one is zero.",
)  # fmt: skip
@click.option("--to", metavar="TIME", help="Along a path, until then.")
@click.option("--from", "start", metavar="TIME", help="Where the path begins (0 s, or the first line of --setpoints).")
@click.option("--points", type=click.IntRange(2), default=501, metavar="N", help="Instants of the path (501).")
@click.option("--moving", is_flag=True, help="The path need not begin at rest.")
@click.option(
    "--limit", "limits", multiple=True, metavar="INPUT=VALUE", help="How large an input may be along a path: `push1=60 V`."
)  # fmt: skip
@click.option(
    "--out", metavar="F.csv", help="Write inputs and outputs along the path as a table, or those of each setpoint (then also .npz, .nc, .mat)."
)  # fmt: skip
@click.option(
    "--controller", metavar="F.bg", help="Write the model with these inputs; their table goes beside it, as F.csv."
)
@picture_option("F.png", "Draw inputs and outputs along the path")
def invert(
    asked: AnalysisCall, targets: Sequence[str], setpoints: str | None, inputs: Sequence[str], limits: Sequence[str], controller: str | None, **path: Any
) -> None:  # fmt: skip
    """Find inputs that give outputs: held at rest, or along a path in time."""
    if bool(targets) == (setpoints is not None):
        raise click.UsageError("say what is wanted by --want, or by --setpoints")
    written = (
        (asked.files.out, (".csv",) if setpoints is None else TABLES, "--out"),
        (controller, (".bg",), "--controller"),
        (asked.files.plot, PICTURES, "--plot"),
    )
    check_targets(*written)
    if path["to"] is None and setpoints is None:
        for file, _, option in written:
            if file is not None:
                raise click.UsageError(f"{option} is for inputs along a path: say with --to until when")
    wanted = settings_by_name(targets, "--want", "x=1 um")
    model, path["limits"] = asked.model, settings_by_name(limits, "--limit", "volt=10 V")
    if setpoints is not None:
        found: Any = model.invert_file(setpoints, inputs, **asked.keywords, **path)
    elif path["to"] is not None:
        found = model.invert(wanted, inputs, **asked.keywords, **path)
    else:
        found = model.invert(wanted, inputs, **asked.keywords)
    _write(found, written)
    asked.print(found)


def _write(found: Any, written: Sequence[tuple[str | None, tuple[str, ...], str]]) -> None:
    """Write the requested files. Raises `click.UsageError` for a file that the result does not have."""
    ways = (("write", "to_csv"), ("to_model",), ("plot",))
    for (path, _, option), names in zip(written, ways, strict=True):
        way = next((getattr(found, name) for name in names if hasattr(found, name)), None)
        if path is not None and way is None:
            raise click.UsageError(f"{option} is for inputs along a path: say with --to until when")
        if path is not None and way is not None:
            way(path)
