"""What several commands take: their options, and what is made of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ..model import Model

model_option = click.option("--model", metavar="NAME", help="The model to use, if the file has several.")
file_argument = click.argument("file", metavar="FILE")
outputs_option = click.option(
    "--output",
    "outputs",
    multiple=True,
    metavar="NAME",
    help="Only this output (several times: these); what they do not need is left out.",
)
experiment_option = click.option(
    "-e", "--experiment", default="", metavar="NAME", help="Which experiment (`none` for none); the first if left out."
)
analysed_option = click.option(
    "-e", "--experiment", default="none", metavar="NAME", help="With what this experiment sets and starts; none if left out."
)  # fmt: skip
settings_option = click.option(
    "--set", "settings", multiple=True, metavar="NAME=VALUE", help="Set a parameter (`a=171 um`) or an input."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print it as JSON, in SI and Hz.")
inputs_option = click.option(
    "--input", "inputs", multiple=True, metavar="NAME", help="From this input, parameter or signal (several times: these)."
)  # fmt: skip
state_option = click.option(
    "--at", "state", default="equilibrium", type=click.Choice(["equilibrium", "start"]), help="At rest, or at the start."
)  # fmt: skip
time_option = click.option(
    "--time", "time", metavar="TIME", help="Inputs as they are then; where the experiment begins if left out."
)


def load(file: str, model: str | None) -> Model:
    from ..model import load

    return load(Path(file), model)


def setting(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name.strip() or not value.strip():
        raise click.UsageError(f'--set takes NAME=VALUE, as in --set "a=171 um"; this is `{text}`')
    return name.strip(), value.strip()


def check_target(path: str, endings: tuple[str, ...], option: str) -> None:
    from ..files import check_writable

    if not path.endswith(endings):
        raise click.UsageError(f"{option} takes a file that ends in {' or '.join(endings)}; this is `{path}`")
    check_writable(path)


@contextmanager
def workers(jobs: int | None) -> Iterator[Any]:
    """Processes that make points of a sweep; None for this one."""
    if not jobs or jobs == 1:
        yield None
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(jobs, get_context("spawn")) as executor:
        yield executor


def named(experiment: str) -> str | None:
    return None if experiment == "none" else experiment


def seconds_of(time: str | None) -> float | None:
    if time is None:
        return None
    from ..simulation.run import seconds

    return seconds(time)


def echo(found: Any, as_json: bool) -> None:
    click.echo(json.dumps(found.to_json(), indent=2) if as_json else found.summary())
