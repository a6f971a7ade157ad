"""Sliders of a model in a notebook, by ipywidgets: the model runs again at each change, and its plot follows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

from compiler.api import BoundedParameter, CompilationFailed

from ..errors import MissingPackage, RunFailed, UsageError
from ..quantities import in_unit
from ..results.result import Result

if TYPE_CHECKING:
    from ipywidgets import FloatLogSlider, FloatSlider, VBox

STEPS = 200  # positions of a slider


@dataclass(frozen=True)
class SliderRange:
    """Range of a slider: its `bounds` and the model's `value` in SI (None: it has none), the unit to show, and that in SI."""

    bounds: BoundedParameter
    value: float | None
    written: str
    kind: str

    @property
    def unit(self) -> str:
        """The author's unit, else that in SI."""
        return self.written or self.kind

    def shown(self, value: float) -> float:
        """Return a value in SI in the unit to show."""
        return in_unit(value, self.unit, self.kind, self.bounds.name)


def explorer(simulate: Callable[[Mapping[str, str | float]], Result], ranges: Sequence[SliderRange]) -> VBox:
    """Return sliders with the plot and the summary of the run at their values. Raises `UsageError`, `MissingPackage`, and what the first run raises."""
    try:
        from ipywidgets import HTML, Image, VBox
    except ImportError as error:
        raise MissingPackage("BR947", "sliders need ipywidgets:", 'pip install "bondgraph-lang[notebook]"') from error

    sliders = [_slider(each) for each in ranges]
    plot, text = Image(format="png"), HTML()

    def run() -> None:
        result = simulate({r.bounds.name: f"{s.value!r} [{r.unit}]" for r, s in zip(ranges, sliders, strict=True)})
        stream = BytesIO()
        result.plot().savefig(stream, format="png", dpi=110)
        plot.value, text.value = stream.getvalue(), f"<pre>{escape(result.summary())}</pre>"

    def follow(_: object) -> None:
        try:
            run()
        except (CompilationFailed, UsageError, RunFailed) as problem:
            text.value = f"<pre>{escape(str(problem))}</pre>"

    run()
    for slider in sliders:
        slider.observe(follow, "value")
    return VBox([*sliders, plot, text])


def _slider(of: SliderRange) -> FloatSlider | FloatLogSlider:
    from ipywidgets import FloatLogSlider, FloatSlider

    name, logarithmic = of.bounds.name, of.bounds.logarithmic
    if of.bounds.low is None or of.bounds.high is None or (logarithmic and of.bounds.low <= 0):
        raise UsageError(
            "BR948", f"{name}: a slider has two ends, above zero if it is logarithmic;", "write `LOW .. HIGH`"
        )
    low, high = of.shown(of.bounds.low), of.shown(of.bounds.high)
    middle = math.sqrt(low * high) if logarithmic else (low + high) / 2
    first = middle if of.value is None else min(max(of.shown(of.value), low), high)
    kind = FloatLogSlider if logarithmic else FloatSlider
    ends = (math.log10(low), math.log10(high)) if logarithmic else (low, high)
    return kind(
        first, min=ends[0], max=ends[1], step=(ends[1] - ends[0]) / STEPS, description=f"{name} [{of.unit}]",
        continuous_update=False, readout_format=".4g", style={"description_width": "initial"},
    )  # fmt: skip
