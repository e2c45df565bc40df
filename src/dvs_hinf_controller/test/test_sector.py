"""Lemmas 1 to 4 of the paper by brute force: the sector holds, and no smaller one does."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_common.scenario.reference_bounds import ReferenceBounds
from dvs_hinf_controller.analysis.sector import estimate, sector, spacing

thresholds = st.floats(0.01, 1.0)
bases = st.sampled_from([2.0, math.e, 10.0])
lowers = st.floats(1e-3, 1e3)
spreads = st.floats(1.0, 3.0)


def constants(lower, spread, threshold, base):
    bounds = ReferenceBounds(lower=np.array([lower]), upper=np.array([lower * spread]))
    return sector(bounds, event_threshold=threshold, log_base=base), lower, lower * spread


def silent_luminosities(lower, upper, threshold, base, points=41):
    """References q in [m, M], and for each the y at which no event fires (paper, eq. 5)."""
    q = np.geomspace(lower, upper, points)
    y = q[:, None] * base ** np.linspace(-threshold, threshold, points)
    return q[:, None], y


@given(lowers, spreads, thresholds, bases)
def test_the_initial_reference_is_known_to_within_its_error(lower, spread, threshold, base):
    found, m, upper = constants(lower, spread, threshold, base)
    q = np.linspace(m, upper, 1001)

    worst = np.max(np.abs(found.initial_reference - q) / q)

    assert worst == pytest.approx(found.initial_error[0], rel=1e-9, abs=1e-12)
    for factor in (0.999, 1.001):
        assert np.max(np.abs(factor * found.initial_reference - q) / q) > worst


@given(lowers, spreads, thresholds, bases)
def test_the_estimate_before_any_event_stays_in_its_sector(lower, spread, threshold, base):
    found, m, upper = constants(lower, spread, threshold, base)
    _, y = silent_luminosities(m, upper, threshold, base)

    errors = np.abs(found.initial_estimate - y) / y

    assert errors.max() == pytest.approx(found.error_bound[0], rel=1e-9)


@given(lowers, spreads, thresholds, bases, st.floats(-0.5, 0.5).filter(lambda d: abs(d) > 1e-3))
def test_no_other_initial_estimate_has_a_smaller_worst_error(
    lower, spread, threshold, base, relative_change
):
    found, m, upper = constants(lower, spread, threshold, base)
    _, y = silent_luminosities(m, upper, threshold, base)
    other = found.initial_estimate * (1 + relative_change)

    assert np.max(np.abs(other - y) / y) > found.error_bound[0]


@given(
    lowers,
    spreads,
    thresholds,
    bases,
    st.integers(-30, 30),
    st.sampled_from([1, -1]),
    st.floats(0, 1),
    st.floats(-1, 1),
)
def test_the_estimate_stays_in_its_sector_after_any_events(
    lower, spread, threshold, base, count, sign, where, level
):
    found, m, upper = constants(lower, spread, threshold, base)
    q = m * (upper / m) ** where * base ** (threshold * count)
    y = sign * q * base ** (threshold * level)

    z = estimate(
        found,
        np.array([count]),
        np.array([sign]),
        event_threshold=threshold,
        log_base=base,
    )

    assert abs(z[0] - y) <= found.error_bound[0] * abs(y) * (1 + 1e-9)


@given(lowers, spreads, thresholds, bases)
def test_the_estimate_is_the_amplified_reference(lower, spread, threshold, base):
    found, m, upper = constants(lower, spread, threshold, base)
    rho = base**-threshold

    assert found.spacing == pytest.approx(rho, rel=1e-12)
    assert found.initial_estimate == pytest.approx(found.amplification * found.initial_reference)
    assert found.amplification == pytest.approx((upper + m) * rho / (upper + m * rho**2))
    assert 0 < found.error_bound[0] < 1


def test_a_known_reference_has_the_smallest_sector():
    # m = M: delta_z = (1 - rho^2) / (1 + rho^2) = tanh(h ln b).
    found, *_ = constants(0.4, 1.0, 0.15, math.e)

    assert found.initial_error == [0]
    assert found.error_bound == pytest.approx([math.tanh(0.15)], rel=1e-12)


def test_the_numbers_of_the_papers_figure():
    # Paper, figure on the best rho and lambdabar: deltabar = 0.35, m = 1, M = 1.4.
    delta, m, upper = 0.35, 1.0, 1.4
    rho = math.sqrt(upper / m * (1 - delta) / (1 + delta))
    found = sector(
        ReferenceBounds(lower=np.array([m]), upper=np.array([upper])),
        event_threshold=-math.log(rho),
        log_base=math.e,
    )

    assert rho == pytest.approx(0.8210, abs=5e-5)
    assert found.spacing == pytest.approx(rho)
    # 1.10838, which the paper cuts to four digits.
    assert found.initial_estimate == pytest.approx([1.1083], abs=1e-4)
    assert found.error_bound == pytest.approx([delta])


def test_pixels_have_constants_of_their_own():
    lower, upper = np.array([0.2, 0.5, 3.0]), np.array([0.3, 0.5, 4.0])
    together = sector(ReferenceBounds(lower=lower, upper=upper), event_threshold=0.1, log_base=2.0)

    for i in range(3):
        alone, *_ = constants(lower[i], upper[i] / lower[i], 0.1, 2.0)
        assert together.error_bound[i] == pytest.approx(alone.error_bound[0])
        assert together.initial_estimate[i] == pytest.approx(alone.initial_estimate[0])


@pytest.mark.parametrize(
    ('threshold', 'base', 'name'),
    [
        (0.0, 2.0, 'event_threshold'),
        (-0.1, 2.0, 'event_threshold'),
        (math.nan, 2.0, 'event_threshold'),
        (math.inf, 2.0, 'event_threshold'),
        (0.1, 1.0, 'log_base'),
        (0.1, 0.5, 'log_base'),
        (0.1, math.nan, 'log_base'),
    ],
)
def test_a_threshold_or_base_out_of_range_is_refused(threshold, base, name):
    with pytest.raises(ParameterError) as caught:
        spacing(threshold, base)
    assert caught.value.name == name
