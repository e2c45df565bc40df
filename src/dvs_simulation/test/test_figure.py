"""Labels of the picture of a run."""

import pytest

from dvs_common.drawing import Figure
from dvs_simulation.judging.figure import PowersOfTen


@pytest.mark.parametrize(
    ('lowest', 'highest', 'labels'),
    [
        (1e-3, 20.0, {'10⁻³', '10⁻²', '10⁻¹', '10⁰', '10¹'}),
        (0.02, 0.07, {'2×10⁻²', '3×10⁻²', '4×10⁻²', '6×10⁻²'}),
        (0.061, 0.069, {'6.2×10⁻²', '6.4×10⁻²', '6.6×10⁻²', '6.8×10⁻²'}),
    ],
)
def test_powers_of_ten_are_plain_text(lowest, highest, labels):
    axes = Figure().subplots()
    axes.set(yscale='log', ylim=(lowest, highest))
    axes.yaxis.set_major_formatter(PowersOfTen())
    axes.yaxis.set_minor_formatter(PowersOfTen())

    found = {label.get_text() for label in axes.yaxis.get_ticklabels(which='both')}
    assert found - {''} >= labels
