"""A state that grows without bound: results until then have full accuracy, and the run ends at the singularity."""

from __future__ import annotations

import numpy as np
import pytest

import bondgraph


@pytest.mark.parametrize("to", [1.5, 2.0, 50.0])
def test_what_is_known_before_an_explosion(to: float) -> None:
    """x' = x^2 from 1 is 1/(1 - t)."""
    model = bondgraph.load("plain model Explosion { output x = integral(x^2, 1) }")
    with pytest.raises(bondgraph.RunFailed, match=r"grows without bound") as failed:
        model.simulate(to=to, points=round(20 * to) + 1)
    result = failed.value.result
    assert result is not None and result.checkpoint is not None
    assert result.checkpoint.time == pytest.approx(1.0, abs=1e-6)
    known = result.time < 0.95
    assert known.sum() == 19
    np.testing.assert_allclose(result["x"][known], 1 / (1 - result.time[known]), rtol=1e-5)
