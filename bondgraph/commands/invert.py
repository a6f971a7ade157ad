"""`bondgraph invert`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .options import (
    analysed_option,
    check_target,
    echo,
    file_argument,
    json_option,
    load,
    model_option,
    named,
    setting,
    settings_option,
)
from .telling import problems_told


@click.command("invert")
@file_argument
@click.option(
    "--want", "targets", multiple=True, required=True, metavar="OUTPUT=VALUE",
    help="An output at rest, `x=8 um`; with --to along a path, `x=8 um*smoothstep9(time, 0 s, 5 ms)`.",
)  # fmt: skip
@click.option(
    "--by", "inputs", multiple=True, required=True, metavar="INPUT|PUSH/PULL", help="An input to find, or two of which one is zero."
)  # fmt: skip
@click.option("--to", metavar="TIME", help="Along a path, until then.")
@click.option("--from", "start", default="0 s", metavar="TIME", help="Where the path begins (0 s).")
@click.option("--points", type=click.IntRange(2), default=501, metavar="N", help="Instants of the path (501).")
@click.option("--moving", is_flag=True, help="The path need not begin at rest.")
@click.option(
    "--limit", "limits", multiple=True, metavar="INPUT=VALUE", help="How large an input may be along a path: `push1=60 V`."
)  # fmt: skip
@click.option("--out", metavar="F.csv", help="Write inputs and outputs along the path as a table.")
@click.option(
    "--controller", metavar="F.bg", help="Write the model with these inputs; their table goes beside it, as F.csv."
)
@click.option("--plot", metavar="F.png", help="Draw inputs and outputs along the path (.png, .svg or .pdf).")
@analysed_option
@settings_option
@json_option
@model_option
def command(
    file: str, targets: Sequence[str], inputs: Sequence[str], to: str | None, start: str, points: int, moving: bool, limits: Sequence[str],
    out: str | None, controller: str | None, plot: str | None, experiment: str, settings: Sequence[str], as_json: bool, model: str | None,
) -> None:  # fmt: skip
    """Find inputs that give outputs: held at rest, or along a path in time."""
    with problems_told():
        written = ((out, (".csv",), "--out"), (controller, (".bg",), "--controller"), (plot, (".png", ".svg", ".pdf"), "--plot"))  # fmt: skip
        for path, endings, option in written:
            if path is not None:
                check_target(path, endings, option)
                if to is None:
                    raise click.UsageError(f"{option} is for inputs along a path: say with --to until when")
        chosen, wanted, given = load(file, model), dict(map(setting, targets)), dict(map(setting, settings))
        if to is None:
            echo(chosen.invert(wanted, inputs, named(experiment), given), as_json)
            return
        found = chosen.invert(
            wanted, inputs, named(experiment), given, to=to, start=start, points=points, moving=moving, limits=dict(map(setting, limits))
        )  # fmt: skip
        for path, write in ((out, found.to_csv), (controller, found.to_model), (plot, found.plot)):
            if path is not None:
                write(path)
        echo(found, as_json)
