"""`bondgraph invert`."""

from __future__ import annotations

from collections.abc import Sequence

import click

from .analysis import PICTURES, Asked, analysis, check_targets, picture_option, write_all
from .options import setting


@analysis("invert", of_outputs=False)
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
@picture_option("F.png", "Draw inputs and outputs along the path")
def command(
    asked: Asked, targets: Sequence[str], inputs: Sequence[str], to: str | None, start: str, points: int, moving: bool, limits: Sequence[str],
    out: str | None, controller: str | None, plot: str | None,
) -> None:  # fmt: skip
    """Find inputs that give outputs: held at rest, or along a path in time."""
    written = ((out, (".csv",), "--out"), (controller, (".bg",), "--controller"), (plot, PICTURES, "--plot"))
    check_targets(*written)
    model, wanted = asked.model, dict(map(setting, targets))
    if to is None:
        for path, _, option in written:
            if path is not None:
                raise click.UsageError(f"{option} is for inputs along a path: say with --to until when")
        asked.answer(model.invert(wanted, inputs, asked.experiment, asked.settings))
        return
    found = model.invert(
        wanted, inputs, asked.experiment, asked.settings, to=to, start=start, points=points, moving=moving,
        limits=dict(map(setting, limits)),
    )  # fmt: skip
    write_all((out, found.to_csv), (controller, found.to_model), (plot, found.plot))
    asked.answer(found)
