"""The synthesis methods by name; packages add their own by an entry point.

The modules of a method are imported when it is used: a program uses one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points

from dvs_common.errors import ParameterError
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.options import DesignOptions

Synthesis = Callable[[DesignProblem, DesignOptions], LinearController]

# Group of entry points; each loads an object with `name` and `synthesize`.
ENTRY_POINTS = 'dvs_hinf_controller.methods'


@dataclass(frozen=True, slots=True, kw_only=True)
class SynthesisMethod:
    """A way to find a controller; what it promises is measured afterwards.

    Parameters
    ----------
    name
        Name by which the user asks for it: the parameter `method`.
    synthesize
        Finds a controller K on the mean of zbar for a problem, or raises `SynthesisError` that
        names the assumption that fails.
    """

    name: str
    synthesize: Synthesis


def _unstructured(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Minimise sup_w ||W G(jw)||: H-infinity synthesis (paper, section IV.A)."""
    from dvs_hinf_controller.synthesis.error_units import for_the_error
    from dvs_hinf_controller.synthesis.group_weights import synthesize_groups

    return for_the_error(problem, lambda model: synthesize_groups(problem, options, model))


def _structured(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Minimise mu = sup_w (|T| + ||W G||): the sector as it is (paper, section IV.A)."""
    from dvs_hinf_controller.synthesis.error_units import for_the_error
    from dvs_hinf_controller.synthesis.structured import synthesize_structured

    return for_the_error(problem, lambda model: synthesize_structured(model, options))


def _certified(problem: DesignProblem, options: DesignOptions) -> LinearController:
    """Maximise h_certified: peak-to-peak design (docs/theory.md, "A guarantee")."""
    from dvs_hinf_controller.synthesis.certified import synthesize_certified

    return synthesize_certified(problem, options)


METHODS = {
    method.name: method
    for method in (
        SynthesisMethod(name='unstructured', synthesize=_unstructured),
        SynthesisMethod(name='structured', synthesize=_structured),
        SynthesisMethod(name='certified', synthesize=_certified),
    )
}


def method_names() -> tuple[str, ...]:
    """Names of the suite's methods and of those that installed packages register."""
    return (*METHODS, *(entry.name for entry in entry_points(group=ENTRY_POINTS)))


def synthesis_method(name: str) -> SynthesisMethod:
    """Return the method called `name`, of the suite or of an installed package.

    Parameters
    ----------
    name
        One of `method_names`.

    Raises
    ------
    ParameterError
        If there is no such method, listing those that there are, or if it can't be loaded.
    """
    if name in METHODS:
        return METHODS[name]
    for entry in entry_points(group=ENTRY_POINTS, name=name):
        try:
            method: SynthesisMethod = entry.load()
        except Exception as error:
            rule = f'can not be loaded from {entry.value}: {error}'
            raise ParameterError('method', name, rule) from error
        if not callable(getattr(method, 'synthesize', None)):
            raise ParameterError('method', name, f'is {entry.value}, which has no synthesize')
        return method
    raise ParameterError('method', name, f'must be one of {", ".join((*method_names(), "file"))}')
