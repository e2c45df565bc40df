"""The search for the least gamma gives what plain bisection does, in fewer tests."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_hinf_controller.synthesis.gamma_search import GammaSearch, GammaTest
from dvs_hinf_controller.synthesis.synthesis_error import Assumption

RTOL = 1e-5


def radius_with(least, power, absent):
    """Test of a problem with this least gamma; below `absent` of it a solution is absent."""

    def test(gamma):
        radius = (least / gamma) ** power
        if gamma < absent * least:
            return GammaTest(gamma=gamma, failure=Assumption.X_ABSENT, spectral_radius=math.nan)
        failure = Assumption.SPECTRAL_RADIUS if radius >= 1 else None
        return GammaTest(gamma=gamma, failure=failure, spectral_radius=radius)

    return test


def bisection(test):
    low, high = 1e-8, 1.0
    while test(high).failure is not None:
        low, high = high, 10 * high
    while low == 1e-8 and high > 1e-8:
        if test(high / 10).failure is not None:
            low = high / 10
        else:
            high /= 10
    while high > low * (1 + RTOL):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if test(middle).failure is not None else (low, middle)
    return high


@given(
    least=st.floats(1e-4, 1e6),
    power=st.sampled_from([0.5, 1.0, 2.0, 4.0]),
    absent=st.sampled_from([0.0, 0.8, 0.999, 1.0, 1.5]),
    near=st.sampled_from([None, 1.0, 1 + 1e-6, 0.5, 3.0]),
)
@settings(max_examples=200, deadline=None)
def test_the_result_is_that_of_plain_bisection_to_the_bit(least, power, absent, near):
    test = radius_with(least, power, absent)
    search = GammaSearch(test, rtol=RTOL)
    assert search.least(None if near is None else near * least) == bisection(test)


@pytest.mark.parametrize(('near', 'tests'), [(None, 12), (2.3459, 5)])
def test_a_smooth_radius_takes_few_tests(near, tests):
    search = GammaSearch(radius_with(2.3459, 2.0, 0.9), rtol=RTOL)
    search.least(near)
    assert len(search.tests) <= tests


def test_there_may_be_none():
    search = GammaSearch(radius_with(1e11, 1.0, 0.0), rtol=RTOL)
    assert search.least() is None
    assert search.tests[-1].gamma == 1e10
