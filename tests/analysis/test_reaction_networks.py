"""Rests of networks of reactions that are written as rates: sums of amounts stay as at the start, and a rest among many is told."""

from __future__ import annotations

import math

import pytest

import bondgraph
from bondgraph.errors import RunFailed
from tests.compiling import MODELS


def rest(rates: dict[str, str], start: dict[str, float], signals: str = "") -> bondgraph.Equilibrium:
    """Return the rest of states with these rates."""
    states = "\n".join(f"  signal {n} = integral({rate}, {start[n]})" for n, rate in rates.items())
    outputs = ", ".join(f"at_{n} = {n}" for n in rates)
    return bondgraph.load(f"plain model Network {{\n{states}\n{signals}\n  output {outputs}\n}}").equilibrium()


@pytest.mark.parametrize(
    ("used", "made", "share"),
    [
        ("-s^2 - s", "s^2 + s", 1.0),
        ("-s*(s + 1)", "s*s + s", 1.0),
        ("-s*(s + 1)/(2 + s)", "3*s*(1 + s)/(2 + s)", 3.0),
        ("-exp(s)*s", "s*exp(s)/2", 0.5),
        ("1 - s*s", "s^2 - 1", 1.0),
    ],
)
def test_a_product_that_nothing_reads_is_what_was_used(used: str, made: str, share: float) -> None:
    """It was as at the start: nothing had been made, and nothing said so."""
    found = rest({"s": used, "p": made}, {"s": 5, "p": 0})
    assert found["at_p"] == pytest.approx(share * (5 - found["at_s"]), abs=1e-9) and found.note == ""


def test_enzyme() -> None:
    rates = {"s": "-2*e*s + c", "e": "-2*e*s + 1.5*c", "c": "2*e*s - 1.5*c", "p": "0.5*c"}
    found = rest(rates, {"s": 5, "e": 1, "c": 0, "p": 0})
    assert [found[f"at_{n}"] for n in rates] == pytest.approx([0, 1, 0, 5], abs=1e-9)


def test_fluxes_with_names_and_volumes() -> None:
    """s and p are concentrations in a volume of 3, the others amounts: 3 s + c + 3 p stays."""
    rates = {"s": "(back - bound)/3", "e": "back - bound + made", "c": "bound - back - made", "p": "made/3"}
    found = rest(rates, {"s": 5, "e": 1, "c": 0, "p": 0}, "  signal bound = 2*s*e, back = c/2, made = 0.5*c")
    assert found["at_p"] == pytest.approx(5, abs=1e-8)


def test_an_unstable_start_is_left_as_the_motion_leaves_it() -> None:
    """The first step was just the time of the mode that grows: it had no solution, and the rest was at -5e8 infected."""
    rates = {"s": "-0.3*s*i + 0.05*r", "i": "0.3*s*i - 0.1*i", "r": "0.1*i - 0.05*r"}
    found = rest(rates, {"s": 0.99, "i": 0.01, "r": 0})
    assert [found[f"at_{n}"] for n in rates] == pytest.approx([1 / 3, 2 / 9, 4 / 9], rel=1e-9)
    assert found.stable and found.note == ""


@pytest.mark.parametrize(
    ("rates", "start", "names"),
    [
        ({"s": "-0.3*s*i", "i": "0.3*s*i - 0.1*i", "r": "0.1*i"}, {"s": 0.99, "i": 0.01, "r": 0}, "`s`, `r`"),
        ({"s": "-s", "p": "s^2"}, {"s": 5, "p": 0}, "`p`"),
        # all that changes a and b has vanished; what nothing reads begins to move later
        (
            {"a": "0.352*b*c - 0.685*c*a", "b": "-6.8*c*b + 0.685*c*a", "c": "-6.449*c*b"},
            {"a": 0.87, "b": 1.84, "c": 0.49},
            "",
        ),
        ({"a": "-a", "b": "a - b", "d": "b^2"}, {"a": 1, "b": 0, "d": 0}, "`d`"),
    ],
)
def test_a_rest_among_many_is_told(rates: dict[str, str], start: dict[str, float], names: str) -> None:
    """How many an epidemic leaves follows from its course: s was -8e13."""
    found = rest(rates, start)
    assert f"many rests, which differ in {names}" in found.note
    assert all(0 <= found[f"at_{n}"] <= 5 for n in rates)


def test_a_last_correction_is_small() -> None:
    """Null vectors with one small component were none: corrections of rounding moved s by 3, and amounts that nothing changes by 0.2."""
    rates = {
        "a": "0",
        "b": "0",
        "c": "0",
        "d": "0.548*d*e + 0.366*f - 2.967*d",
        "e": "-0.548*d*e",
        "f": "2.967*d - 0.366*f",
    }
    found = rest(rates, {"a": 0, "b": 0, "c": 0, "d": 0.15, "e": 0.72, "f": 0})
    d = 0.87 * 0.366 / (0.366 + 2.967)
    assert [found[f"at_{n}"] for n in rates] == pytest.approx([0, 0, 0, d, 0, 0.87 - d], abs=1e-8)


def test_rates_that_are_rounding_need_no_correction() -> None:
    """It was refused: an amount that stays drove a rate of 3e-17."""
    rates = {
        "a": "0.867*d - 1.223*a + 1.718*e - 0.101*a", "b": "0", "c": "-4.794*c*e", "d": "9.588*c*e - 0.867*d + 1.223*a",
        "e": "-4.794*c*e - 6.803*b*e - 1.718*e + 0.101*a",
    }  # fmt: skip
    found = rest(rates, {"a": 0.43, "b": 0, "c": 0, "d": 1.92, "e": 1.36})
    assert found["at_d"] / found["at_a"] == pytest.approx(1.223 / 0.867, rel=1e-9)
    assert found["at_a"] + found["at_d"] + found["at_e"] == pytest.approx(0.43 + 1.92 + 1.36, rel=1e-9)


@pytest.mark.parametrize(
    ("rates", "start", "right"),
    [
        # all rates vanish with the square of d: b, which a vanished amount reads, was at -3e31
        (
            {"a": "4.102*d*d - 0.856*a", "b": "0.216*a", "d": "1.28*a - 8.204*d*d", "e": "-2.434*b*e"},
            {"a": 0, "b": 0, "d": 1.64, "e": 1.56}, {"a": 0, "b": 0.82, "d": 0, "e": 0},
        ),
        # 3 (a + b + c + d) + e + 2 f stays: e was 5.91
        (
            {
                "a": "1.206*d - 0.569*a*c - 0.103*a", "b": "0.569*a*c - 5.522*b + 5.204*f*e", "c": "0.103*a + 0.4*d - 0.153*c",
                "d": "-1.206*d - 0.4*d + 0.153*c", "e": "5.522*b - 5.204*f*e + 12.358*f", "f": "5.522*b - 5.204*f*e - 6.179*f",
            },
            {"a": 0, "b": 0, "c": 0.5, "d": 0.26, "e": 1.89, "f": 0.83}, {"a": 0, "c": 0, "e": 5.83, "f": 0},
        ),
    ],
)  # fmt: skip
def test_sums_are_kept_where_amounts_vanish_with_a_product(
    rates: dict[str, str], start: dict[str, float], right: dict[str, float]
) -> None:
    """The last steps are as long as the slowest motion, whose direction rounding made of sums that every motion keeps."""
    found = rest(rates, start)
    assert [found[f"at_{n}"] for n in right] == pytest.approx(list(right.values()), abs=1e-7)


def test_a_state_that_grows_for_ever_hides_no_rate() -> None:
    """a was 4.5e13 at rest, stable, with a rate of 0.07: in units of its terms that was nothing."""
    rates = {
        "a": "0.212*e - 0.135*a*d + 0.736*c", "b": "2.771*d - 0.994*b + 0.736*c", "c": "8.2*e - 3.308*c - 1.297*c*d + 5.315*e*d",
        "d": "0.212*e - 2.771*d - 0.135*a*d + 0.243*b", "e": "0.135*a*d - 8.412*e + 1.93*c + 1.297*c*d - 5.315*e*d + 0.23",
    }  # fmt: skip
    with pytest.raises(RunFailed, match="the rate of `a` does not vanish"):
        rest(rates, {"a": 1.57, "b": 0, "c": 1.43, "d": 0, "e": 0.27})


def test_laws_of_elements_tell_what_stays() -> None:
    """Two ports of a reaction with opposite laws: n + 2 d stays, so this is the one rest."""
    found = bondgraph.load(MODELS / "reaction.bg").equilibrium()
    assert found.note == "" and math.isclose(found["n_monomer"] + 2 * found["n_dimer"], 2.004, rel_tol=1e-9)
