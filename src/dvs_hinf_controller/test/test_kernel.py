"""Impulse responses that are summed part by part."""

import numpy as np
import pytest

from dvs_hinf_controller.analysis.kernel import Kernel


@pytest.mark.parametrize(('count', 'kept'), [(1, 1), (7, 3), (9000, 2)])
def test_responses_that_are_summed_by_parts_are_those_of_the_whole(count, kept):
    generator = np.random.default_rng(count)
    kernel = Kernel(
        times=np.arange(count, dtype=float),
        states=generator.normal(size=(count, 6)),
        outputs=generator.normal(size=(4, 5, 6)),
        weights=generator.uniform(size=count),
        slop=np.zeros(5),
        state_quadrature=0.0,
        state_tail=0.0,
    )

    summed = kernel.summed(kept)

    by_definition = np.einsum('rs,pos->pro', kernel.states, kernel.outputs)
    sums = np.einsum('r,pro->po', kernel.weights, np.abs(by_definition))
    np.testing.assert_allclose(kernel.values, by_definition, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(summed.values, by_definition[:, :, :kept], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(summed.sums, sums, rtol=1e-9)
