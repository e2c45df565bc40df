"""The words of the report."""

from __future__ import annotations

from types import MappingProxyType

from dvs_simulation.paper.experiments import (
    RUN_THRESHOLD,
    Counterexample,
    Experiment,
    ThresholdCurve,
)
from dvs_simulation.paper.report import Picture, Section
from dvs_simulation.paper.table import Experiments

CAPTIONS = MappingProxyType(
    {
        'platform': 'The appendix: the camera (green frame) on its platform over a linear '
        'brightness profile, in slow motion. The orange dot is the set-point, the dashed '
        'circle the tolerance; events flash at the top right, red for ON, blue for OFF.',
        'pixel_grid': 'Relative positions of the nine pixels, numbered as in the paper.',
        'staircase': 'Zero-order hold of the events of pixel 1 in the closed loop (mirror image, '
        'r = 3): filled dots are positive, hollow dots negative events.',
        'sector': 'Estimate against luminosity with unit amplification. Positive and negative '
        'transitions overlap, which makes this no logarithmic quantiser, yet every path stays '
        'between the borders.',
        'optimization': 'Theorem 3: the two constraints meet in one point, which is the least '
        'spacing and so the largest event threshold.',
        'error_methods': 'Error against time, unstructured and structured controller, r = 3, '
        'printed example. The first 0.8 s are enlarged on the left.',
        'phase_methods': 'Phase portrait of the same two runs; on the right around the set-point.',
        'bode': 'Largest gain from D to x over all perturbations of the size of the sector, at '
        'each frequency. The structured controller pays for its lower peak with a slightly higher '
        'gain at zero frequency.',
        'error_pixels': 'Error against time for one, three and nine pixels, structured '
        'controller, printed example.',
        'phase_pixels': 'The same three runs as a phase portrait; on the right around x_d.',
        'positivity': 'Luminosity of the first pixel in the printed example and in its mirror '
        'image, which is the same control problem.',
        'small_gain': 'Small gain of the counterexample at the delta* of Theorem 1: it holds at '
        'zero frequency, where the formula implies it, and fails between about 2 and 100 rad/s.',
        'counterexample': 'Left: the error of the counterexample keeps leaving the tolerance at '
        'h = 0.15. Right: its limsup against h, with the threshold that the theorems allow after '
        'the true small-gain condition has been added, and the guaranteed one.',
        'certificate': 'Guaranteed and simulated error against h in the mirror example, r = 1: no '
        'dot lies above its curve.',
    }
)


def sections(
    experiments: Experiments,
    counterexample: Counterexample,
    curves: list[ThresholdCurve],
    pictures: dict[str, Picture],
) -> list[Section]:
    """All sections with the numbers of this run.

    Parameters
    ----------
    experiments
        Runs by (example, r, method).
    counterexample
        The counterexample.
    curves
        Error against h by method.
    pictures
        Figures by name.
    """

    def section(anchor: str, title: str, *paragraphs: str, show: tuple[str, ...] = ()) -> Section:
        return Section(
            anchor=anchor,
            title=title,
            paragraphs=paragraphs,
            pictures=tuple(pictures[name] for name in show),
        )

    return [
        section(
            'problem',
            'The problem',
            'A camera whose pixels report only that the logarithm of their brightness has moved '
            'by a threshold h watches a linear plant. From those events alone a controller is to '
            'hold the plant within eps of a set-point. How coarse may the threshold be?',
            show=('platform', 'pixel_grid'),
        ),
        section(
            'estimator',
            'The estimator and its sector',
            'Between events nothing is known, so the estimate is held. Whatever happens, it stays '
            'within a relative error delta_z of the luminosity: an uncertainty that robust '
            'control knows how to handle.',
            show=('staircase', 'sector', 'optimization'),
        ),
        section(
            'controllers',
            'Two controllers',
            _methods_text(experiments),
            show=('error_methods', 'phase_methods', 'bode'),
        ),
        section(
            'pixels',
            'One, three and nine pixels',
            _pixels_text(experiments),
            show=('error_pixels', 'phase_pixels'),
        ),
        section(
            'numbers',
            'Every number beside its reference',
            'The rows of the paper are its published numbers. The rows "check" are the optima of '
            'the reduced problem, which the published h* of r = 3 and r = 9 miss because their '
            'D-K iteration had not converged, and an earlier computation of the counterexample, '
            'which moves with how near to its optimum the controller is.',
        ),
        section(
            'positivity',
            'Correction 1: light is not negative',
            'In the printed example the luminosity changes its sign, against the assumption (A1) '
            'that it rests on. It can be run with a pixel that takes the logarithm of |y|, is '
            'silent where |y| < 1e-4 and sends the sign along with its events; no real sensor '
            'does that. The mirror image of the set-point is the same problem with positive '
            'light, and this package uses it wherever it can.',
            show=('positivity',),
        ),
        section(
            'small_gain',
            'Correction 2: small gain at every frequency',
            'Stability needs delta* ||Gw1|| < 1 at all frequencies. The formula of Theorem 1 '
            'implies it at zero frequency only. For the controllers of the paper it holds; in '
            'general it has to be checked.',
            show=('small_gain',),
        ),
        section(
            'counterexample',
            'Correction 3: the error does not settle',
            _counterexample_text(counterexample),
            show=('counterexample',),
        ),
        section(
            'certificate',
            'A threshold that is a guarantee',
            _certificate_text(curves),
            show=('certificate',),
        ),
    ]


def _peak(experiment: Experiment) -> float:
    assert experiment.run.tail is not None
    return experiment.run.tail.peak


def _mean(experiment: Experiment) -> float:
    assert experiment.run.tail is not None
    return experiment.run.tail.mean


def _methods_text(experiments: Experiments) -> str:
    parts = []
    for method in ('unstructured', 'structured'):
        experiment = experiments['paper', 3, method]
        parts.append(
            f'{method}: h* = {experiment.design.figures.h_star:.4f}, long-run error '
            f'{_mean(experiment):.4f} on average and {_peak(experiment):.4f} at most'
        )
    return (
        'H-infinity synthesis that treats the uncertainties of all pixels as one, and '
        'mu-synthesis that knows they are separate. Both exact runs use h = '
        f'{RUN_THRESHOLD:g} and three pixels. ' + '; '.join(parts) + '.'
    )


def _pixels_text(experiments: Experiments) -> str:
    parts = [
        f'r = {r}: {_mean(experiments["paper", r, "structured"]):.4f} on average, '
        f'{_peak(experiments["paper", r, "structured"]):.4f} at most'
        for r in (1, 3, 9)
    ]
    return (
        'The paper observes that the long-run average error "seems to increase" with the number '
        'of pixels. In the exact runs it is ' + '; '.join(parts) + '. One run each proves '
        'little: the study "pixels" of the sweep command averages over many starts.'
    )


def _counterexample_text(counterexample: Counterexample) -> str:
    h, peak = (
        counterexample.experiments[1].loop.event_threshold,
        _peak(counterexample.experiments[1]),
    )
    return (
        'Theorem 1 uses the final value theorem, as if the relative error of the estimate were '
        'constant in the end. It jumps at every event. A controller with a small gain at zero '
        'frequency and a larger one above makes the theorem promise much: with the true '
        f'small-gain condition added it allows h = {counterexample.h_allowed:.2f}. At h = {h:.2f} '
        f'the error already reaches {peak:.4f} > eps = 0.05, for ever. So h* is a figure to '
        'report, not a guarantee.'
    )


def _certificate_text(curves: list[ThresholdCurve]) -> str:
    parts = ', '.join(
        f'{curve.design.method} {curve.design.figures.h_certified:.4f}' for curve in curves
    )
    return (
        'For errors that vary with time in any way the peak gains of the closed loop (the L1 '
        'norms of its kernels) bound the error, and so give a threshold h_certified that is a '
        f'guarantee. In the mirror example with one pixel it is: {parts}. A controller that is '
        'designed for it comes nearest to h*.'
    )
