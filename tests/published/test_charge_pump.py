"""The charge pump of the test set for IVP solvers: charges of a transistor, index 2. Its charges have no energy, and that is reported."""

from __future__ import annotations

from pathlib import Path

from tests.compiling import mistake

FILE = Path(__file__).parent / "charge_pump.bg"


def test_charges_without_an_energy_are_refused() -> None:
    """The published charges give half of the channel to the drain even where it is cut off. There the gate does not feel the drain,
    dQ_G/du_D = 0, but the drain feels the gate, dQ_D/du_G = -C_ox/3: round a closed path of voltages energy would come from nothing.
    """
    found = mistake(FILE, "BG405")
    assert "`mos`" in found.sentence and "creates energy" in found.sentence
    assert "energy" in found.help
