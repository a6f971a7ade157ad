"""A model as a functional mock-up unit of FMI 2.0 or 3.0: model exchange and co-simulation in one file, without a compiler or a linker.

The libraries are linked here from object code: that of the runtime, which is the same for all models, and that of the program.
Models that a unit cannot hold are refused by the line of the text that stands against it.
"""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from typing import TYPE_CHECKING, NoReturn

from compiler import api
from compiler.api import CompilationFailed, NotInUnit, narrow_conditions

from .. import cache
from ..compiled_scene import chosen_target
from ..errors import UsageError
from ..native import CannotCompile, compiled_for, kernel
from ..simulation.integrators.compiled.sources import VECTORS
from ..simulation.run_options import DEFAULT_POINTS
from .functions import LEFT_OUT, VERSIONS, FmiVersion
from .image import FUNCTIONS, ModelImage, image_of
from .interface import llvm_data, llvm_interface
from .interface_c import c_unit
from .model_description import UnitHead, build_description, model_description, terminals_and_icons
from .osp import osp_model_description
from .reference import reference_run
from .start import StartValues, start_values
from .variables import FmuVariable, UnitIcon, UnitTerminal, own_names, terminals_of, variables_of

if TYPE_CHECKING:
    from compiler.api import Compilation, LibraryModule, NotJoined, Plan, Scene, Span

    from ..compiled_model import CompiledModel

NARROW = (
    "Laws may be narrow in their states: co-simulation meets them; in model exchange steps have to be short enough to."
)
SOURCES = ("program.c", "fmu.c")
READABLE = 0o644 << 16
OPTIMISED = 1  # level of the runtime
CHOICES = api.Choices(LEFT_OUT, VECTORS)
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # date of the files, so that equal models give equal bytes
_MATHEMATICS = frozenset((
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil", "copysign", "cos", "cosh", "erf", "erfc", "exp", "exp2", "expm1",
    "fabs", "floor", "fma", "fmod", "hypot", "lgamma", "log", "log10", "log1p", "log2", "pow", "remainder", "rint", "round", "sin", "sinh", "sqrt",
    "tan", "tanh", "tgamma", "trunc",
))  # fmt: skip
_MEMORY = frozenset(("calloc", "free", "malloc", "memcmp", "memcpy", "memmove", "memset", "strcmp", "strlen"))
_GNU = (("libm.so.6", _MATHEMATICS), ("libc.so.6", _MEMORY))
# The second has what a function calls that needs more than a page of the stack.
_WINDOWS = (("ucrtbase.dll", _MATHEMATICS | _MEMORY), ("ntdll.dll", frozenset({"__chkstk"})))
_RUN = "Run the model here, or give other tools the run's numbers (`run --out R.csv`)."


@dataclass(frozen=True, slots=True)
class FmuPlatform:
    """A platform: its word for us and for LLVM, the folders of FMI 2.0 and 3.0, the ending of its libraries, and those of the system."""

    word: str
    folders: Mapping[str, str]
    system: tuple[tuple[str, frozenset[str]], ...]
    ending: str = ".so"


PLATFORMS: Mapping[str, FmuPlatform] = {
    p.word: p
    for p in (
        FmuPlatform("linux64", {"2.0": "linux64", "3.0": "x86_64-linux"}, _GNU),
        FmuPlatform("linux-aarch64", dict.fromkeys(("2.0", "3.0"), "aarch64-linux"), _GNU),
        FmuPlatform("win64", {"2.0": "win64", "3.0": "x86_64-windows"}, _WINDOWS, ".dll"),
    )
}


@dataclass(frozen=True, slots=True)
class UnitInstance:
    """A compiled scene in which all is free, its experiment, and what an instance of it begins with."""

    compilation: Compilation
    plan: Plan
    values: StartValues
    module: LibraryModule
    image: ModelImage


@dataclass(frozen=True, slots=True)
class _UnitParts:
    """Parts that all platforms share."""

    module: LibraryModule
    image: ModelImage
    head: UnitHead
    version: FmiVersion


@dataclass(frozen=True, slots=True)
class FmuUnit:
    """A unit: its files, its variables, their names by those in the model, the plan of its experiment, and what libcosim looks for beside it."""

    files: Mapping[str, bytes]
    variables: tuple[FmuVariable, ...]
    names: Mapping[str, str]
    plan: Plan
    beside: Mapping[str, bytes]


def fmu(
    model: CompiledModel, experiment: str | None = None, platforms: Sequence[str] = ("linux64",), fmi: str = "2",
    ports: Mapping[str, str] | None = None, icon: UnitIcon | None = None,
) -> FmuUnit:  # fmt: skip
    """Return a unit.

    All parameters can be set, except what decides which parts there are; all inputs are free. With an experiment its settings are in it.
    Start, stop and tolerance are those of
    the experiment, or of the first one. `ports`: open ports of the model, each with `effort` or `flow`, which comes from outside.
    `icon`: its picture in other tools.
    Raises `CompilationFailed`, `UsageError`, `RunFailed`.
    """
    for port, side in (ports or {}).items():
        if side not in ("effort", "flow"):
            raise UsageError("BR620", f"the port `{port}` is given `{side}`; a unit takes its `effort` or its `flow`")
    scene = api.Scene(model.model, experiment or "", ports=tuple((ports or {}).items()))
    return unit_of(model, scene, experiment, platforms, fmi, icon)


def unit_of(
    model: CompiledModel, first: Scene, experiment: str | None, platforms: Sequence[str], fmi: str, icon: UnitIcon | None = None,
    starts: Mapping[str, float] | None = None,
) -> FmuUnit:  # fmt: skip
    """Return the unit of a scene, which has the first experiment where none is named. `starts`: of inputs."""
    for word in platforms or ("",):
        if word not in PLATFORMS:
            raise UsageError("BR640", f"there is no platform `{word}`; platforms are {', '.join(PLATFORMS)}")
    if fmi not in VERSIONS:
        raise UsageError("BR618", f"no unit of FMI `{fmi}` can be written; versions are {', '.join(VERSIONS)}")
    version, ports = VERSIONS[fmi], dict(first.ports)
    instance = instance_of(model, first, experiment, starts)
    compilation, plan, values, module = instance.compilation, instance.plan, instance.values, instance.module
    structure = api.structure_of(compilation.lowered)
    descriptions = {name: q.description for name, q in compilation.whole_graph.quantities.items()}
    variables = variables_of(compilation.lowered, structure, values, descriptions, version.number == "3.0")
    names = own_names(variables, first.unit)
    variables = tuple(replace(item, name=names[item.name]) for item in variables)
    image = instance.image
    token = hashlib.sha256(
        repr((module.text, image, variables, version.number, cache.code_version())).encode()
    ).hexdigest()[:32]
    parts = _UnitParts(module, image, _head(compilation, plan, values, f"{{{token}}}"), version)
    files = {
        "modelDescription.xml": model_description(parts.head, variables, plan.report, version.number).encode("utf-8")
    }
    terminals = terminals_of(compilation, ports) if ports else ()
    files |= _terminals(terminals, version, icon)
    for word in platforms:
        platform = PLATFORMS[word]
        files[f"binaries/{platform.folders[version.number]}/{parts.head.identifier}{platform.ending}"] = _library(
            parts, word
        )
    files |= _sources(compilation, parts)
    if first.unit is None:  # a unit of a system has inputs from others
        written = (v.name for v in variables if v.causality == "output" and not v.is_clock)
        outputs = dict(zip(compilation.lowered.space.outputs, written, strict=True))
        files |= reference_run(model, compilation.scene, parts.head, outputs)
    beside = {}
    if terminals and version.number == "2.0":
        beside[f"{parts.head.name}_OspModelDescription.xml"] = osp_model_description(terminals).encode("utf-8")
    return FmuUnit(files, variables, names, plan, beside)


def instance_of(
    model: CompiledModel, first: Scene, experiment: str | None, starts: Mapping[str, float] | None = None
) -> UnitInstance:
    """Return what the instances of a scene begin with. Raises `CompilationFailed`, `RunFailed`."""
    chosen_target("native")
    compilation = _compilation(model, replace(first, experiment=experiment, free=frozenset({"*"})))
    refuse(compilation)
    plan = model.compilation(first).plan
    compiled_scene = model.compiled_scene(compilation.scene, True, "native")
    example = (
        None if experiment and first.unit is None else model.compiled_scene(replace(first, unit=None), True, "native")
    )
    values = start_values(compiled_scene, compilation, plan, experiment, example)
    if starts:
        variables_in = [compilation.lowered.space.variables[number] for number in compilation.lowered.inputs]
        inputs = [starts.get(i.name, v) for i, v in zip(variables_in, values.inputs, strict=True)]
        values = replace(values, inputs=inputs)
    module = api.library_module(compilation.lowered, FUNCTIONS)
    return UnitInstance(compilation, plan, values, module, image_of(compiled_scene.program, module, values))


def _terminals(terminals: Sequence[UnitTerminal], version: FmiVersion, icon: UnitIcon | None) -> dict[str, bytes]:
    """Return the files of the icon, and of the terminals, which FMI 2.0 does not know."""
    if version.number == "2.0":
        return {} if icon is None else {"model.png": icon.png}
    if not terminals and icon is None:
        return {}
    text = terminals_and_icons(terminals, icon)
    pictures = {} if icon is None else {"icon.png": icon.png, "icon.svg": icon.svg}
    files = {"terminalsAndIcons.xml": text.encode("utf-8"), **pictures}
    return {f"terminalsAndIcons/{name}": data for name, data in files.items()}


def _compilation(model: CompiledModel, scene: Scene) -> Compilation:
    """Return the stages of a scene in which all is free, differentiated by the inputs that no experiment sets."""
    if model.compilation(scene, everything=True).whole_graph.switches:
        scene = replace(scene, joined=True, off=())
    try:
        scene = model.without_zero_divisors(scene, everything=True)
        variables = model.compilation(scene, everything=True).state_space.variables
    except api.NotJoined as reason:
        refuse_junctions(reason)
    inputs = tuple(v.name for v in variables if v.role == "input")
    if not inputs:
        return model.compilation(scene, everything=True)
    return model.compilation(replace(scene, by=inputs), everything=True)


def _head(compilation: Compilation, plan: Plan, values: StartValues, token: str) -> UnitHead:
    name = compilation.whole_graph.name
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    points = round(plan.settings.get("points", DEFAULT_POINTS))
    return UnitHead(
        name, identifier if not identifier[:1].isdigit() else f"_{identifier}", token, _description(compilation), plan.start, plan.stop,
        values.tolerances.relative, points, len(compilation.lowered.events.located), SOURCES,
    )  # fmt: skip


def _description(compilation: Compilation) -> str:
    """Return the text that an author has put behind the name of a model, and what an importer has to know of its laws."""
    model = compilation.tree.models.get(compilation.whole_graph.name)
    texts = [s.text for s in model.statements if isinstance(s, api.Description)] if model is not None else []
    return " ".join([*texts[:1], *([NARROW] if compilation.lowered.peaks else [])])


def _library(parts: _UnitParts, platform: str) -> bytes:
    """Return the shared library of a platform."""
    runtime = kernel(
        "runtime of exported units",
        lambda: api.translate(_runtime(), choices=CHOICES) + llvm_interface(),
        OPTIMISED,
        platform,
    )
    text = parts.module.text + llvm_data(parts.image, parts.head.token, parts.version)
    own, row = compiled_for(text, parts.module.level, platform), PLATFORMS[platform]
    library = api.SharedLibrary(parts.head.identifier + row.ending, parts.version.exported(), row.system)
    try:
        return api.link([runtime, own], library)
    except api.LinkError as problem:
        raise CannotCompile("BR601", f"machine code could not be made: {problem}") from None


def _runtime() -> list[Callable[..., object]]:
    """Return the functions of the runtime that any version calls."""
    return [*dict.fromkeys(f for version in VERSIONS.values() for f in version.sources())]


def _sources(compilation: Compilation, parts: _UnitParts) -> dict[str, bytes]:
    """Return the unit as files of C: the program, and the functions that an importer calls."""
    program, prefix = api.write_library_c(compilation.lowered)
    texts = dict(zip(SOURCES, (program, c_unit(parts.image, parts.head.token, prefix, parts.version)), strict=True))
    if parts.version.number == "3.0":
        texts["buildDescription.xml"] = build_description(parts.head)
    return {f"sources/{name}": text.encode("utf-8") for name, text in texts.items()}


def zipped(files: Mapping[str, bytes]) -> bytes:
    """Return an archive of files, whose bytes depend on them alone."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, LONG_AGO)
            entry.external_attr = READABLE
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def refuse(compilation: Compilation) -> None:
    """Raise `CompilationFailed` with all that a unit cannot hold."""
    if refusals := [NotInUnit(span, what, instead) for span, what, instead in _obstacles(compilation)]:
        raise CompilationFailed(refusals)


def refuse_junctions(reason: NotJoined) -> NoReturn:
    """Raise `CompilationFailed` for switched junctions that a unit cannot hold."""
    raise CompilationFailed([NotInUnit(reason.span, reason.words, _RUN)])


def _obstacles(compilation: Compilation) -> Iterator[tuple[Span, str, str]]:
    space, graph = compilation.state_space, compilation.whole_graph
    lowered = compilation.lowered
    if space.forced:
        name = space.variables[space.forced[0].variable].name
        yield space.forced[0].span, f"the rate of `{name}`, which may jump as only a run sees,", _RUN
    for event in lowered.events.events:
        if event.span.unit is not None:
            text = "Join the two in the tool that imports this one."
            yield event.span, f"`{event.owner}`, a unit itself ({event.span.source.name})", text
        for setting in event.settings:
            if setting.kind == "state" and space.invariants:
                text = "Let it change a `mode`, on which forces depend."
                yield setting.span, f"`{setting.words}`, which an event sets in a model with constraints", text
            if setting.kind == "computed":
                text = "Set the state of a storage, or a `mode`."
                yield setting.span, f"`{setting.words}`, which an event sets and states compute", text
    if space.delays:
        yield space.delays[0].span, "delayed signals, whose past has no largest size,", _RUN
    multipliers = 0 if lowered.solved is None else len(lowered.solved.multipliers)
    if multipliers < len(space.unknowns) and (lowered.events.present or multipliers):
        names = ", ".join(f"`{space.variables[u.variable].name}`" for u in space.unknowns[:3])
        what = "closed loops of a mechanism" if multipliers else "events"
        why = "where a run searches for another solution,"
        yield graph.span, f"nonlinear algebraic loops ({names}) beside {what}, {why}", _RUN
    elif space.unknowns and not space.states:
        what = "nonlinear algebraic loops of a model without states, one of whose solutions a run follows,"
        yield graph.span, what, _RUN
    if space.claims and not space.invariants:
        text = "Give the start of the storage itself."
        yield graph.span, "starts of quantities that are computed from states", text
    for number, _, _ in narrow_conditions(lowered):
        text = "Compare without quotients, exponentials and high powers of what moves: multiply by the divisor, take logarithms or roots; or "
        text += "compare a state that follows them, `signal y = integral((x - y)/T, 0)`."
        yield lowered.events.located[number].note.span, "a condition that may hold for less than a step shows", text
    if lowered.crossings:
        yield graph.span, "instants that only a search over time finds", _RUN
