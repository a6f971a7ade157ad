"""Stages of one scene, each kept once it is computed, and the choices that a scene leaves open: forms of storages, switches, what cancels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from .causality import CausalGraph, assign_causality
from .causality.valves import with_fitting_modes
from .codegen.common_factors import with_shared_products
from .codegen.identity import identity
from .codegen.lower import following, lower, moving
from .codegen.lowered import Lowered
from .codegen.program import Program
from .codegen.zero_divisors import zero_divisors
from .equations import EquationSystem, notes
from .equations.companion import companion, companion_inputs
from .equations.fields import field_checks
from .equations.products import integrands
from .errors import CompilationFailed, Diagnostic, standing
from .fast_dataclass import dataclass
from .garbage_collection import uncollected
from .graph.network import BondGraph, Element, over_arguments
from .graph.prune import derivative_wishes, known_zeros, preferring, prune
from .graph.switch import decided, off_at_the_start, switch_off
from .graph.valves import Valve, switched_gaps, with_gaps
from .part import part_alone
from .pipeline import Request, derive, equations_of, is_steep
from .reduction import (
    Certificate,
    LinearLoops,
    StateSpace,
    behind_loops,
    certify,
    joined,
    linear_loops,
    reduce_equations,
    refuse_idle_coordinates,
    refuse_singular_loops,
    without_what_cancels,
)
from .reduction.errors import DerivativeWithoutEnd, SingularLoop
from .reduction.measured import measurement_notes
from .reduction.unexcited import at_rest, without
from .reduction.upstream import upstream
from .scene import Plan, RunMetadata, Scene
from .semantics import MAXIMUM_PARTS, Built, build_graph, open_part
from .semantics.names.compound_units import setting_notes, unit_notes, with_compound_units
from .semantics.names.errors import TooLongRow
from .source import Source
from .syntax import SyntaxTree, parse

if TYPE_CHECKING:
    from .codegen.program_image import ProgramImage
    from .system import System

MOST_TIES = 60  # storages whose derivative form is tried where a loop is singular


@dataclass(eq=False)
class Compilation:
    """One model for one scene. Each stage is computed on first access. Raises `CompilationFailed`."""

    source: Source
    scene: Scene
    library: Path | None = None
    everything: bool = False  # all states and powers, as an energy balance needs
    most_parts: int = MAXIMUM_PARTS
    cancels = False  # True once the equations were reduced without what cancels

    @cached_property
    def tree(self) -> SyntaxTree:
        return with_compound_units(parse(self.source))

    @property
    def open_part(self) -> str | None:
        """Name of the model if it has ports, so that it is only usable in a larger one."""
        return open_part(self.tree, self.scene.model)

    @cached_property
    def _built(self) -> Built:
        if self.scene.unit is not None:
            whole = replace(self, scene=replace(self.scene, unit=None))
            return whole.system(self.scene.unit[1]).alone(whole._built, self.scene.unit[0])
        with uncollected():
            built = build_graph(self.tree, self.scene, self.library, self.most_parts)
        return built if "*" not in self.scene.free else built.checking(*field_checks(built.graph))

    def system(self, parts: Sequence[str]) -> System:
        """The model cut at the ports of some instances."""
        from .system import cut

        with self._instances():
            return cut(assign_causality(preferring(self.whole_graph, dict.fromkeys(self.given_way))), parts)

    @property
    def whole_graph(self) -> BondGraph:
        """The graph of the whole text."""
        return self._built.graph

    @property
    def plan(self) -> Plan:
        return self._built.plan

    @property
    def structural(self) -> frozenset[str]:
        """Quantities that decide which parts there are."""
        return self._built.structural

    @property
    def choices(self) -> Mapping[str, tuple[str, ...]]:
        """Parameters that are one of several words, with these, and those that are texts, with none."""
        return self._built.choices

    @property
    def truths(self) -> frozenset[str]:
        return self._built.truths

    @property
    def files(self) -> tuple[Source, ...]:
        """Files read in addition to the text: imported files and columns of numbers."""
        return self._built.files

    @cached_property
    def zeros(self) -> frozenset[str]:
        """Quantities that are always zero in this run."""
        return known_zeros(self.whole_graph, self._settable)

    @property
    def _settable(self) -> frozenset[str]:
        """Quantities whose values are no part of the program."""
        overridden = {o.path for o in self.scene.overrides if o.role == "set"} - self.scene.fixed
        return self.scene.free | overridden

    @property
    def later(self) -> frozenset[str]:
        """Names of quantities set when a run begins: no stage may depend on their values."""
        return frozenset(o.path for o in self.scene.overrides if o.value is None)

    @cached_property
    def graph(self) -> BondGraph:
        """The graph without elements that contribute nothing in this run, and without the preferences that are dropped."""
        return preferring(self._wished, dict.fromkeys(self.given_way))

    @cached_property
    def _switched_off(self) -> BondGraph:
        """The whole graph of a companion with its other switched junctions off; what shares with a port does not decide for it."""
        ports = {**dict.fromkeys(self.gaps, ()), **{v.junction: v.events for v in self.valves}}
        return switch_off(self._switched[0], self.off, ports, frozenset(ports))

    @cached_property
    def _wished(self) -> BondGraph:
        if self.scene.companion:
            return prune(companion(self._switched_off, self.gaps), self.zeros)
        graph = switch_off(self._switched[0], self.off, {v.junction: v.events for v in self.valves})
        return preferring(prune(graph, self.zeros), dict(self.scene.preferences))

    @cached_property
    def valves(self) -> tuple[Valve, ...]:
        """The switched junctions whose effort and flow are complementary."""
        return self._switched[1]

    @cached_property
    def _switched(self) -> tuple[BondGraph, tuple[Valve, ...]]:
        """The whole graph with a gap for each ideal valve, and these."""
        graph = decided(self.whole_graph, self._settable) if self.whole_graph.switches else self.whole_graph
        if not graph.switches:
            return graph, ()
        graph, valves = with_gaps(graph)
        if valves and self.scene.off is None:
            off, own = off_at_the_start(graph, self.plan.start), {v.junction: v.events for v in valves}
            written = graph.quantities
            graph = with_fitting_modes(
                graph, valves, off, lambda g, names: prune(switch_off(g, names, own), self.zeros)
            )
            valves = tuple(
                replace(v, fitted=graph.quantities[v.mode].definition != written[v.mode].definition) for v in valves
            )
        return graph, valves

    @cached_property
    def gaps(self) -> tuple[str, ...]:
        """All two-terminal switches, valves first."""
        return switched_gaps(*self._switched) if self._switched[0].switches else ()

    @property
    def _free(self) -> frozenset[str]:
        """The inputs and parameters that stay arguments of the program."""
        own = companion_inputs(self._switched_off, self.gaps) if self.scene.companion else ()
        return self.scene.free | {*own}

    @cached_property
    def off(self) -> tuple[str, ...]:
        """Switched junctions that are off; at the start, those that the modes alone determine to be off."""
        if self.scene.off is not None:
            return self.scene.off
        return off_at_the_start(self._switched[0], self.plan.start) if self._switched[0].switches else ()

    @cached_property
    def given_way(self) -> tuple[str, ...]:
        """Storages whose preferred derivative form was dropped because it would leave them or others undetermined.

        Only the equations show if the laws leave a storage to its own derivatives, so they are derived to find out.
        """
        graph, given_way = self._wished, tuple[str, ...]()
        while wishes := derivative_wishes(graph, but=self._changed):
            try:
                with uncollected():
                    found = derive(graph, self._request)
            except CompilationFailed as failed:
                endless = [d.element for d in failed.diagnostics if isinstance(d, DerivativeWithoutEnd)]
                if len(endless) < len(failed.diagnostics):
                    break  # another error, which is reported unchanged
                ending = [n for n in wishes if n in endless] or wishes
                graph, given_way = preferring(graph, dict.fromkeys(ending)), given_way + tuple(ending)
            else:
                self.__dict__.update(causal=found.causal, equations=found.equations, _reduced=found.reduced)
                return given_way
        return given_way

    @property
    def _request(self) -> Request:
        return Request(self.zeros, self._free, self._changed, self.everything, self.scene.opened, self.scene.steep)

    @property
    def _changed(self) -> frozenset[str]:
        """Storages whose form changed in the middle of a run."""
        return frozenset(name for name, _ in self.scene.preferences)

    @cached_property
    def causal(self) -> CausalGraph:
        with self._instances():
            return assign_causality(self.graph)

    @cached_property
    def equations(self) -> EquationSystem:
        with self._instances():
            return equations_of(self.causal, self._request)

    @property
    def state_space(self) -> StateSpace:
        """The equations that this scene computes: of a run without states that nothing excites, of a part without those behind no output."""
        return self._computed[0]

    @property
    def unexcited(self) -> tuple[str, ...]:
        """States that stay at zero in a run of this scene, which does not compute them."""
        return self._computed[1]

    @cached_property
    def _computed(self) -> tuple[StateSpace, tuple[str, ...]]:
        whole, system, left = self.whole_space, self.equations, self._at_rest
        if self.scene.joined and whole.switches:
            return joined(whole, [v.junction for v in self.valves], self._space_switched), ()
        if left:
            system = without(system, left)
        elif self.scene.upstream and self.scene.outputs is not None and not self.cancels:
            part = reduce_equations(system, False, self.graph.span, self.scene.opened)
            system = upstream(system, {s.variable for s in part.states})
        else:
            return whole, ()
        try:
            space = reduce_equations(system, self.everything, self.graph.span, self.scene.opened)
        except CompilationFailed:  # nothing would remain, or something cancels
            return whole, ()
        variables = self.equations.variables
        return space, tuple(variables[s.variable].name for s in self.equations.states if s.variable in left)

    def _space_switched(self, off: tuple[str, ...]) -> StateSpace:
        """The equations with these junctions off."""
        other = replace(self, scene=replace(self.scene, joined=False, off=off))
        other.__dict__.update(tree=self.tree, _built=self._built)
        return other.state_space

    @property
    def _at_rest(self) -> frozenset[int]:
        """Variables that stay at zero from the starts; none where a run begins otherwise, or has tolerances of states by name."""
        scene, plan = self.scene, self.plan
        if not scene.from_start or self.everything or scene.companion or scene.preferences or scene.free:
            return frozenset()
        if plan.equilibrium or plan.tolerances:
            return frozenset()
        whole = self.whole_space
        if self.cancels:
            return frozenset()
        # the same states as with closed loops
        return at_rest(reduce_equations(self.equations, False, self.graph.span) if scene.opened else whole, self.later)

    @cached_property
    def whole_space(self) -> StateSpace:
        """The equations behind the outputs, or all of them, in which each loop has a solution."""
        with self._instances():
            try:
                space = self._reduced
                if self.scene.companion:  # lossy at each valve, whatever its numbers are
                    return space
                refuse_singular_loops(linear_loops(space, self.equations, self.scene.free))
            except CompilationFailed as failed:
                if not all(isinstance(d, SingularLoop) for d in failed.diagnostics) or not self._ties(
                    len(failed.diagnostics)
                ):
                    raise
                space = self._reduced
            refuse_idle_coordinates(space)
            if len(space.balances) < len(self.equations.balances):
                self._refuse_idle_unread()
            return space

    def _refuse_idle_unread(self) -> None:
        """Raise what a run with all of its energies would: massless bodies that nothing reads must be determined all the same."""
        try:
            whole = reduce_equations(self.equations, True, self.graph.span, self.scene.opened)
        except CompilationFailed:  # what cancels is left out, and was looked at as it was (`_reduced`)
            return
        refuse_idle_coordinates(whole)

    def _ties(self, singular: int) -> bool:
        """Take storages in derivative form that others decide in a way that no stroke shows, and say whether that leaves every loop with one solution.

        Strokes follow single bonds. Two capacitors between the same two nodes, each on lines of their own, or a coil cut by the balance of a part, are tied
        by sums of several junctions. So storages are tried one by one; the form stays where fewer loops are singular. `singular`: their number so far."""
        held = {self.graph.nodes[end.node].name for end in self.causal.derivative}
        free = [
            n.name
            for n in self.graph.nodes
            if isinstance(n, Element) and n.stored and not (n.prefer or n.require or n.name in held)
        ]
        wishes: dict[str, str | None] = {}
        for name in free[:MOST_TIES]:
            left = self._singular({**wishes, name: "derivative"})
            if left < singular:
                wishes[name], singular = "derivative", left
            if not singular:
                return True
        return False

    def _singular(self, wishes: Mapping[str, str | None]) -> int:
        """The number of singular loops with these wishes, which are kept if there are none; many where it has no equations."""
        graph = preferring(self._wished, {**dict.fromkeys(self.given_way), **wishes})
        try:
            found = derive(graph, self._request)
            refuse_singular_loops(linear_loops(found.reduced, found.equations, self.scene.free))
        except CompilationFailed as failed:
            own = all(isinstance(d, SingularLoop) for d in failed.diagnostics)
            return len(failed.diagnostics) if own else 1_000_000  # more loops than any model has
        self.__dict__.update(graph=graph, causal=found.causal, equations=found.equations, _reduced=found.reduced)
        return 0

    @cached_property
    def _reduced(self) -> StateSpace:
        span = self.graph.span
        try:
            return reduce_equations(self.equations, self.everything, span, self.scene.opened)
        except CompilationFailed as failed:
            less = without_what_cancels(self.equations)
            if less is None or not all(isinstance(d, DerivativeWithoutEnd) for d in failed.diagnostics):
                raise
        self.cancels = True
        # Parts that nothing reads any longer must have a solution too.
        refuse_singular_loops(linear_loops(reduce_equations(less, True, span), less, self.scene.free))
        return reduce_equations(less, self.everything, span, self.scene.opened)

    def look_at_laws(self) -> None:
        """Raise the errors of turning laws into a program, without forming products of derivatives or common factors, which cannot fail."""
        with self._instances():
            lower(self.state_space, whole=False)

    @cached_property
    def _as_written(self) -> Lowered:
        space = self.state_space
        known = [space.quantities[name] for name in self.scene.by if name in space.quantities]
        with self._instances():
            located = not self.scene.opened  # a solution from far away looks at conditions where it is
            return lower(space, located, tuple(dict.fromkeys(known)), self.scene.conserving)

    @cached_property
    def lowered(self) -> Lowered:
        return with_shared_products(self._as_written)

    @cached_property
    def certificate(self) -> Certificate:
        """Kind of the equations that a run of this scene solves."""
        kept = {node.name for node in self.graph.nodes}
        left_out = tuple(node.name for node in self.whole_graph.nodes if node.name not in kept)
        wishes = (
            f"`{name}` is in integral form although it prefers the derivative form: with that nothing would decide what it holds"
            for name in self.given_way
        )
        told = (*notes(self.graph), *measurement_notes(self.state_space), *self.readings, *wishes)
        return certify(self.state_space, self.equations, (left_out, self.unexcited), told)

    @property
    def readings(self) -> Iterator[str]:
        """Notes on units of the text, and of settings, that are read as names of the model."""
        yield from unit_notes(self.tree)
        yield from setting_notes(self.scene.overrides, lambda: self.whole_graph.quantities.keys(), self.source)

    @cached_property
    def facts(self) -> RunMetadata:
        """Further data that a run needs."""
        space = self.state_space
        places = {v: i for i, v in enumerate(moving(space))}
        shown = {name: places[v] for name, v in space.outputs.items() if v in places}
        mechanisms = tuple(n.name for n in self.graph.nodes if n.kind.value == "multibody")
        storages = tuple(n.name for n in self.graph.nodes if n.kind.value in ("C", "I"))
        quantities = self.whole_graph.quantities
        units = {name: quantities[name].unit for name in sorted(self.later)}
        positive = tuple((words, over_arguments(bound, quantities)) for words, bound in self._built.positive)
        looped = frozenset() if not self.later else behind_loops(self.whole_space) & self.later
        unknown = {u.variable: i for i, u in enumerate(space.unknowns)}
        laws = tuple((unknown[w.row], unknown[w.argument], unknown[w.value], w.effort) for w in space.laws)
        written = replace(self, scene=replace(self.scene, steep=False)) if self.scene.steep else self
        return RunMetadata(
            mechanisms, storages, bool(space.claims), shown, units, positive, self.truths, frozenset(n for n in units if quantities[n].counted),
            looped, identity(written._as_written), following(space, places), self.valves, self.gaps, integrands(self.whole_graph), laws,
            zero_divisors(self.whole_space, self.later), is_steep(self.equations), self.graph.undetermined,
        )  # fmt: skip

    def refuse_values(self, values: Mapping[str, float]) -> None:
        """Raise `CompilationFailed` if a linear loop has no solution with these values of quantities set when a run begins."""
        refuse_singular_loops(self._linear_loops, values)

    @cached_property
    def _linear_loops(self) -> LinearLoops:
        return linear_loops(self.whole_space, self.equations, self.scene.free)

    @cached_property
    def program(self) -> Program:
        from .codegen import numpy

        with self._bounded():
            return numpy.generate_program(self.lowered)

    def text(self, target: str) -> str:
        """The program as a text for others, by the name of its target (`text_targets`)."""
        from .codegen.text.targets import target_text

        self.look_at_laws()
        descriptions = {name: quantity.description for name, quantity in self.whole_graph.quantities.items()}
        with self._instances(), self._bounded():
            return target_text(target, self.state_space, descriptions)

    def part_text(self, name: str, target: str) -> str:
        """One instance of the model alone, a controller, as a text for others."""
        from .codegen.text.targets import target_text

        graph = part_alone(self.whole_graph, name)
        zeros = known_zeros(graph, self.scene.free)
        space = derive(prune(graph, zeros), Request(zeros, self.scene.free)).reduced
        return target_text(target, space, {n: q.description for n, q in graph.quantities.items()})

    @cached_property
    def state_equations(self) -> str:
        """The state equations in sympy, as text."""
        from .codegen.symbolic.formulate import formulate
        from .codegen.symbolic.listing import listing

        with self._bounded():
            return "\n".join(listing(formulate(self.state_space)))

    @contextmanager
    def _bounded(self) -> Iterator[None]:
        """Report expressions that are nested too deeply for a writer as an error of the text."""
        try:
            with uncollected():
                yield
        except RecursionError:
            raise CompilationFailed([too_long(self.tree)]) from None

    def native(self, compile_: Callable[[str, int], bytes]) -> tuple[ProgramImage, tuple[bytes, ...]]:
        """The program as data and machine code. `compile_` makes object code of LLVM's text, at an optimization level."""
        from .codegen.llvm.generate import generate_code

        with uncollected():
            return generate_code(self.lowered, compile_)

    @contextmanager
    def _instances(self) -> Iterator[None]:
        """Add to errors inside an instance the line where the instance is declared: the part may be by another author."""
        try:
            with uncollected():
                yield
        except CompilationFailed as failed:
            stands = self.whole_graph.stands
            raise CompilationFailed([standing(item, stands) for item in failed.diagnostics]) from None


def too_long(tree: SyntaxTree) -> Diagnostic:
    """Diagnostic for a model that is nested more deeply than Python's recursion limit."""
    model = list(tree.models.values())[-1]
    return TooLongRow(model.name_span, model.name)
