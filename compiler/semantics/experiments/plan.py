"""Experiments: their settings, read before elaboration, and their plan, read after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ...errors import CompilationFailed, Diagnostic, ValuesNeeded
from ...graph.network import Named
from ...graph.units import ONE, SECOND
from ...scene import Analysis, Fitting, Inverting, Override, Plan, Reported, Scene, Study, full_name
from ...solvers import SOLVERS
from ...source import Source, Span
from ...syntax import parse_expression, tree
from ..expressions.scales import scale_of
from ..names.errors import (
    AbsentName,
    DimensionMismatch,
    DuplicateName,
    UnknownAttribute,
    UnknownName,
    WrongExperiment,
    WrongType,
)
from ..names.scope import Absent, ModelDefinition, Scalar, Scope
from ..names.statement_errors import AlreadyTold, Wrong, describe, suggestion
from ..network.elaborate import Elaborator
from ..resolution.cycles import counts_angle, in_cycles, refuse_rates_of_angles
from .analyses import read_analysis
from .step_attributes import number
from .studies import check_together, read_sweep

SETTINGS = ("rtol", "atol", "accuracy", "points")


def experiments_of(definition: ModelDefinition) -> dict[str, tree.Experiment]:
    """Experiments of a model by name, in the order of the text. Of two with one name, the first is taken."""
    found: dict[str, tree.Experiment] = {}
    for statement in definition.model.statements:
        if isinstance(statement, tree.Experiment):
            found.setdefault(statement.name, statement)
    return found


def choose_experiment(
    definition: ModelDefinition, wanted: str | None
) -> tuple[tree.Experiment | None, list[Diagnostic]]:
    """Return the experiment of that name, and errors. "" chooses the first experiment, None chooses none."""
    experiments = experiments_of(definition)
    mistakes: list[Diagnostic] = [
        DuplicateName(s.span, s.name, experiments[s.name].span)
        for s in definition.model.statements
        if isinstance(s, tree.Experiment) and s is not experiments[s.name]
    ]
    if not wanted:
        return None if wanted is None else next(iter(experiments.values()), None), mistakes
    if wanted not in experiments:
        hint = suggestion(wanted, list(experiments), f"It has: {', '.join(experiments) or 'none'}.")
        where = f"the experiments of `{definition.name}`"
        mistakes.append(UnknownName(definition.model.name_span, wanted, where, hint))
    return experiments.get(wanted), mistakes


def experiment_overrides(experiment: tree.Experiment | None) -> list[Override]:
    """Settings of an experiment."""
    if experiment is None:
        return []
    return [
        Override(full_name(s.target.words), s.value, s.target.span, s.role)
        for s in experiment.steps
        if isinstance(s, tree.Set) and s.role == "set"
    ]


def read_plan(
    elaborator: Elaborator, experiment: tree.Experiment | None, root: Scope, scene: Scene
) -> tuple[Plan, Mapping[str, Named]]:
    """Return the plan of the run, and the outputs that it needs."""
    declared = {p.name: p for p in elaborator.pending if p.role == "output" and p.owner.base() is root}
    outputs: dict[str, Named] = {}
    units: dict[str, Reported] = {}  # of outputs that are declared with one
    for pending in declared.values():
        found = elaborator.guard(elaborator.quantity, pending)
        for scalar in getattr(found, "items", (found,)):
            if isinstance(scalar, Scalar):
                outputs[scalar.name] = elaborator.quantities[scalar.name]
                if pending.item.unit is not None:
                    units[scalar.name] = _in_unit(scalar.name, pending.item.unit)
    plan = Plan(None if experiment is None else experiment.name)
    report: list[Reported] = []
    for step in experiment.steps if experiment is not None else ():
        match step:
            case tree.Simulate():
                plan = elaborator.guard(_simulate, elaborator, step, root, plan) or plan
            case tree.Bandwidth():
                plan = elaborator.guard(_bandwidth, elaborator, step, root, plan) or plan
            case tree.Report():
                for reading in step.readings:
                    found = elaborator.guard(_reading, elaborator, reading, root, outputs)
                    if found is not None:
                        report.append(found if reading.unit is not None else units.get(found.name, found))
            case tree.Analysis(role="equilibrium", attributes=()) if _before_simulate(step, experiment):
                plan = replace(plan, equilibrium=True)
            case tree.SweepSyntax() if experiment is not None:
                swept = elaborator.guard(read_sweep, elaborator, step, experiment, root, plan)
                plan = replace(plan, sweeps=(*plan.sweeps, swept)) if swept is not None else plan
            case tree.Analysis():
                study = elaborator.guard(_analysis, elaborator, step, root, outputs)
                plan = replace(plan, studies=(*plan.studies, study)) if study is not None else plan
    if units and not report:
        report = [units.get(name, Reported(name, output.unit)) for name, output in outputs.items()]
    plan = replace(plan, report=tuple(report))
    elaborator.guard(check_together, experiment, plan)
    return plan, _wanted(elaborator, outputs, plan, scene, root)


def _analysis(elaborator: Elaborator, step: tree.Analysis, root: Scope, outputs: dict[str, Named]) -> Analysis | None:
    """Read one analysis step. Return None if its numbers are set when a run begins, in which case it adds no step."""
    before = dict(elaborator.asked)
    try:
        return read_analysis(elaborator, step, root, outputs)
    except ValuesNeeded:
        if step.role == "response":
            raise
        elaborator.asked = before
        return None


def _before_simulate(step: tree.Analysis, experiment: tree.Experiment | None) -> bool:
    """Return True if a simulation follows the first step with this word: the step then gives its start."""
    steps = experiment.steps if experiment is not None else ()
    first = next((i for i, s in enumerate(steps) if isinstance(s, tree.Analysis) and s.role == step.role), len(steps))
    return any(isinstance(s, tree.Simulate) for s in steps[first:])


def _wanted(
    elaborator: Elaborator, outputs: dict[str, Named], plan: Plan, scene: Scene, root: Scope
) -> Mapping[str, Named]:
    if scene.outputs is not None:
        for name in scene.outputs:
            if isinstance(absent := root.entries.get(name), Absent):
                span = elaborator.root.definition.model.name_span
                elaborator.tell(AbsentName(span, name, absent.branch, absent.span))
            elif name not in outputs and not _asked_for(elaborator, name, root, outputs):
                hint = suggestion(name, list(outputs), f"Outputs: {', '.join(outputs) or 'none'}.")
                elaborator.tell(UnknownName(elaborator.root.definition.model.name_span, name, "the outputs", hint))
        return {n: o for n, o in outputs.items() if n in scene.outputs}
    if plan.report:
        names = [*(r.name for r in plan.report), *(n for n in _seen(plan) if n in outputs)]
        return {name: outputs[name] for name in dict.fromkeys(names)}
    return outputs


def _asked_for(elaborator: Elaborator, name: str, root: Scope, outputs: dict[str, Named]) -> bool:
    """Return True if a name can be reported although it is no declared output, such as `spring.F`; add it to the outputs."""
    source = Source("output", name)
    try:
        value = parse_expression(source)
        if isinstance(value, tree.PathSyntax):
            _reading(elaborator, tree.ReadingSyntax(Span(source, 0, len(name)), value, None), root, outputs)
    except (Wrong, AlreadyTold, CompilationFailed):
        return False
    return name in outputs


def _seen(plan: Plan) -> list[str]:
    """Names of the outputs of analyses and of measured quantities."""
    found: list[str] = []
    for study in plan.studies:
        match study:
            case Study(seen=seen) if seen:
                found.append(seen)
            case Inverting():
                found += [w.output for w in study.wanted]
            case Fitting():
                found += study.measured
    return found


def _simulate(elaborator: Elaborator, step: tree.Simulate, root: Scope, plan: Plan) -> Plan:
    dimension = ONE if root.plain else SECOND
    start = elaborator.static(step.range.first, root, "The start of a simulation", dimension)
    stop = elaborator.static(step.range.last, root, "The end of a simulation", dimension)
    if stop <= start:
        hint = "Write `simulate 0 .. 1 s`."
        raise Wrong(WrongExperiment(step.range.span, "The simulation ends before it begins", hint))
    if plan.stop is not None:
        raise Wrong(WrongExperiment(step.span, "A second `simulate` in one experiment", "Write a second experiment."))
    settings: dict[str, float] = {}
    tolerances: dict[str, float] = {}
    for attribute in step.attributes:
        if attribute.name == "tolerance" and attribute.target is not None:
            scalar = elaborator.lookup(attribute.target, root)
            if not isinstance(scalar, Scalar):
                raise Wrong(WrongType(attribute.target.span, "One quantity", "a list"))
            what = f"The tolerance of `{attribute.target.words}`"
            value = number(elaborator, attribute.value, attribute.target, root, what)
            if value <= 0:
                hint = "Write how large an error is allowed, in the unit of the quantity."
                raise Wrong(WrongExperiment(attribute.span, "A tolerance is positive", hint))
            tolerances[attribute.target.words] = value
        elif attribute.name == "solver" and attribute.target is None:
            plan = replace(plan, solver=_solver(attribute))
        elif attribute.name in SETTINGS and attribute.target is None:
            value = elaborator.static(attribute.value, root, f"`{attribute.name}`")
            settings[attribute.name] = value
            if (
                value <= 0
                or (attribute.name == "rtol" and not 1e-13 <= value <= 0.1)
                or (attribute.name == "accuracy" and not 1e-12 <= value <= 0.1)
                or (attribute.name == "points" and (value < 2 or value != round(value)))
            ):
                hint = "`rtol` lies between 1e-13 and 0.1, `accuracy` between 1e-12 and 0.1, `points` is a whole number from 2."
                raise Wrong(WrongExperiment(attribute.span, f"`{attribute.name} = {value:g}` makes no sense", hint))
        else:
            hint = suggestion(
                attribute.name,
                [*SETTINGS, "solver", "tolerance"],
                "It has: rtol, atol, accuracy, points, solver, and `tolerance NAME = …`.",
            )
            raise Wrong(UnknownAttribute(attribute.span, "simulate", attribute.name, hint))
    return replace(plan, start=start, stop=stop, settings=settings, tolerances=tolerances)


def _bandwidth(elaborator: Elaborator, step: tree.Bandwidth, root: Scope, plan: Plan) -> Plan:
    if plan.bandwidth is not None:
        hint = "Write one, or a second experiment."
        raise Wrong(WrongExperiment(step.span, "A second `bandwidth` in one experiment", hint))
    refuse_rates_of_angles(elaborator, root, step.value)
    value = elaborator.static(step.value, root, "A bandwidth", ONE if root.plain else ONE / SECOND)
    if value <= 0:
        hint = "Write `bandwidth 50 kHz`: what is faster need not be followed."
        raise Wrong(WrongExperiment(step.span, f"A bandwidth of {value:g} Hz makes no sense", hint))
    return replace(plan, bandwidth=value)


def _solver(attribute: tree.Attribute) -> str:
    """The solver that an attribute names."""
    word = attribute.value.span.words if attribute.value is not None else ""
    if word not in SOLVERS:
        hint = suggestion(word, SOLVERS, f"Solvers: {', '.join(SOLVERS)}.")
        raise Wrong(UnknownName(attribute.span, word, "the solvers", hint))
    return word


def _reading(elaborator: Elaborator, reading: tree.ReadingSyntax, root: Scope, outputs: dict[str, Named]) -> Reported:
    name = reading.value.span.words
    template = elaborator.template(reading.value, root)
    if isinstance(template.value, tuple):
        raise Wrong(WrongType(reading.value.span, "A single number", "a list", "Report its items one by one."))
    dimension = template.value.dimension
    if reading.unit is not None:
        wanted = scale_of(reading.unit)
        if dimension is not None and wanted.dimension != dimension:
            what = f"`{name}` is {describe(dimension)}, so it cannot be reported in {reading.unit.span.words}"
            hint = "Name a unit of the same kind."
            raise Wrong(DimensionMismatch(reading.unit.span, what, hint))
        if "Hz" in reading.unit.span.text and counts_angle(elaborator, reading.value, root):
            what = f"`{name}` is the rate of an angle, and {reading.unit.span.text} counts cycles"
            hint = f"Report it in rpm or rad/s, or `{in_cycles(reading.value)}` in {reading.unit.span.text}."
            raise Wrong(DimensionMismatch(reading.unit.span, what, hint))
    if name not in outputs:
        (formula,) = template.formulas
        bound = elaborator.bind(template, formula, root)
        outputs[name] = Named(name, "output", str(dimension or ONE), bound, None, reading.value.span)
    return Reported(name, str(dimension or ONE)) if reading.unit is None else _in_unit(name, reading.unit)


def _in_unit(name: str, unit: tree.Unit) -> Reported:
    scale = scale_of(unit)
    return Reported(name, unit.span.words.replace(" ", ""), scale.from_si(1.0) - scale.from_si(0.0), scale.from_si(0.0))
