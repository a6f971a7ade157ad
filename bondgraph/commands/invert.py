"""`bondgraph invert`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from .analysis import AnalysisCall, analysis, picture_option
from .options import PICTURES, TABLES, check_targets, settings_by_name


@analysis("invert", of_outputs=False, checked=False)
@click.option(
    "--want", "targets", multiple=True, metavar="OUTPUT=VALUE",
    help="An output at rest, `x=8 um`; with --to along a path, `x=8 um*smoothstep9(time, 0 s, 5 ms)`.",
)  # fmt: skip
@click.option(
    "--setpoints", metavar="S.csv",
    help="Outputs from a file: `x [um],phi [deg]`, each line held at rest; with a column `time [s]` a path through its lines.",
)  # fmt: skip
@click.option(
    "--by", "inputs", multiple=True, required=True, metavar="INPUT|PUSH/PULL", help="An input to find, or two of which one is zero."
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
def command(
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
