"""Commands that print a stage of the compiler, or tell something of it: show, equations, causality, certificate, explain, compile."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath

import click

from . import completion
from .error_reporting import WRONG, stop
from .options import (
    STREAM,
    check_target,
    experiment_option,
    file_argument,
    load,
    model_option,
    named,
    outputs_option,
    seconds_of,
    settings_by_name,
    settings_option,
    written,
)

FMU, SSP = ".fmu", ".ssp"  # endings of functional mock-up units, and of systems of them


@click.command("show")
@file_argument
@click.option(
    "--stage",
    required=True,
    metavar="STAGE",
    shell_complete=completion.stages,
    help="syntax, graph, causality, equations, reduction, state_equations, code; or text: back in the language, flat.",
)
@experiment_option
@model_option
def show(file: str, stage: str, experiment: str, model: str | None) -> None:
    """Print one stage of the compiler."""
    click.echo(load(file, model).show(stage, named(experiment)))


@click.command("equations")
@file_argument
@click.option("--latex", is_flag=True, help="As LaTeX.")
@model_option
def equations(file: str, latex: bool, model: str | None) -> None:
    """Print the equations in the order in which they are computed."""
    click.echo(load(file, model).equations(latex))


@click.command("causality")
@file_argument
@experiment_option
@model_option
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-causality/1).")
def causality(file: str, experiment: str, model: str | None, as_json: bool) -> None:
    """Print the strokes, and why there are derivative storages and algebraic loops."""
    from ..presentation.text.causality import explain, told

    chosen = load(file, model)
    explanation = explain(chosen.compilation(chosen.scene(named(experiment))))
    click.echo(json.dumps(explanation.to_json(), indent=2) if as_json else explanation.text())
    if explanation.diagnostics:
        stop(told(explanation.diagnostics), WRONG)


@click.command("certificate")
@file_argument
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-certificate/1).")
@model_option
def certificate(file: str, as_json: bool, model: str | None) -> None:
    """Tell what kind of equations a model has: form, index, states, loops, what was left out."""
    kind = load(file, model).certificate
    click.echo(json.dumps(kind.to_json(), indent=2) if as_json else str(kind))


@click.command("explain")
@file_argument
@experiment_option
@settings_option
@outputs_option
@click.option("--for", "duration", default="5 s", metavar="TIME", help="How long to try what zeros save (5 s).")
@model_option
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON (schema bondgraph-explanation/1).")
def explain(
    file: str, experiment: str, settings: Sequence[str], outputs: Sequence[str], duration: str, model: str | None, as_json: bool
) -> None:  # fmt: skip
    """Tell what a run leaves out and why, what remains, what is expensive, and what each output costs and a zero would save."""
    from ..presentation.text.explanation import explain as explained

    chosen = load(file, model)
    experiment_name, assignments, names = named(experiment), settings_by_name(settings), tuple(outputs) or None
    scene = replace(chosen.scene(experiment_name, assignments, outputs=names), from_start=True)
    explanation = explained(chosen.compilation(scene))
    prices = chosen.prices(experiment_name, assignments, names, seconds_of(duration) or 0.0)
    if as_json:
        click.echo(json.dumps({**explanation.to_json(), "prices": prices.to_json()}, indent=2))
    else:
        click.echo(f"{explanation.text()}\n\n{prices.summary()}")


@click.command("compile")
@file_argument
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="MODEL.py|.c|.mo|.diffsl|.fmu|.ssp|-",
    help="The file to write; `-`, with --target, is the standard output.",
)
@click.option(
    "--target",
    metavar="NAME",
    help="Kind of program: numpy, c, casadi, jax, modelica, diffsl. By default what the ending means.",
)
@click.option(
    "--platforms", metavar="NAMES", help="Of an FMU, separated by commas: linux64 (by default), linux-aarch64, win64."
)
@click.option("--fmi", metavar="VERSION", help="Of an FMU: 2 (by default) or 3.")
@click.option(
    "--port", multiple=True, metavar="NAME=effort|flow", help="Of an FMU: an open port, and what comes in there."
)
@click.option(
    "--icon", flag_value="diagram", help="Of an FMU: with the diagram as its icon, for which matplotlib is needed."
)
@click.option(
    "-e",
    "--experiment",
    metavar="NAME",
    help="Of an FMU, and of C with steps of variable size: with the settings of this experiment; by default none.",
)
@click.option(
    "--part",
    multiple=True,
    metavar="INSTANCE",
    help="One instance alone, such as a controller; of an SSP, as often as wanted: an instance that is a unit.",
)
@click.option("--float", "single", is_flag=True, help="C in float instead of double.")
@click.option(
    "--steps", metavar="KIND", help="Of C: fixed (by default), or variable, with the methods and events of a run."
)
@model_option
def compile(
    file: str,
    out: str,
    target: str | None,
    part: tuple[str, ...],
    single: bool,
    model: str | None,
    port: tuple[str, ...],
    **unit: str | None,
) -> None:
    """Write a Python module that needs numpy alone, C that needs nothing, functions of CasADi or JAX, Modelica, DiffSL, an FMU, or a system of FMUs."""
    from compiler.api import target_of, text_targets

    from ..files import write_text

    targets = text_targets().values()
    chosen = [t for t in targets if t.name == target] or targets
    endings = tuple(dict.fromkeys(t.ending for t in chosen))
    if out == STREAM and target is None:
        raise click.UsageError(f"`-o -` has no ending that means a kind: --target {', '.join(t.name for t in targets)}")
    if out != STREAM:
        check_target(out, endings if target else (*endings, FMU, SSP), "--out")
    is_system = out.endswith(SSP)
    a_unit, steps = out.endswith((FMU, SSP)), unit.pop("steps")
    if (out.endswith(FMU) and part) or (a_unit and (single or steps is not None)) or (len(part) > 1 and not is_system):
        raise click.UsageError(
            "--part, --float and --steps belong to a program as a text; several parts, to a system of units"
        )
    if is_system and (port or unit["icon"] is not None):
        raise click.UsageError("--port and --icon belong to an FMU; the ports of the parts of a system are joined")
    platforms, experiment = unit["platforms"], unit["experiment"]
    if a_unit:
        words = tuple(p.strip() for p in ("linux64" if platforms is None else platforms).split(","))
        version = "2" if unit["fmi"] is None else unit["fmi"]
        chosen_model = load(file, model)
        if is_system:
            chosen_model.to_ssp(out, part, experiment, words, version)
        else:
            parts = (text.partition("=") for text in port)  # such as `tip=effort`
            ports = {name.strip(): variable.strip() for name, _, variable in parts}
            chosen_model.to_fmu(out, experiment, words, version, ports, unit["icon"] is not None)
        return
    if steps == "variable":
        unit["experiment"] = None
    if port or any(value is not None for value in unit.values()):
        raise click.UsageError(
            f"--platforms, --fmi, --port, --icon and --experiment belong to an FMU, a file that ends in {FMU}, or a system of them ({SSP})"
        )
    kind = target or target_of(PurePath(out).suffix)
    text = load(file, model).compile(
        kind, part=part[0] if part else None, single=single, steps=steps or "fixed", experiment=experiment
    )
    with written(out, endings[0]) as path:
        write_text(path, text)
