"""The synthesis methods by name; users add their own to the registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dvs_common.errors import ParameterError
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.certified import synthesize_certified
from dvs_hinf_controller.synthesis.options import DesignOptions
from dvs_hinf_controller.synthesis.rolled_off import synthesize_rolled_off
from dvs_hinf_controller.synthesis.structured import synthesize_structured

Synthesis = Callable[[DesignProblem, DesignOptions], LinearController]


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


METHODS = {
    method.name: method
    for method in (
        # Minimise sup_w ||G(jw)||: H-infinity synthesis (paper, section IV.A).
        SynthesisMethod(
            name='unstructured',
            synthesize=lambda problem, options: (
                synthesize_rolled_off(problem.model, options).controller
            ),
        ),
        # Minimise mu = sup_w (|T| + ||G||): the sector as it is (paper, section IV.A).
        SynthesisMethod(
            name='structured',
            synthesize=lambda problem, options: synthesize_structured(problem.model, options),
        ),
        # Maximise h_certified: peak-to-peak design (docs/theory.md, "A guarantee").
        SynthesisMethod(name='certified', synthesize=synthesize_certified),
    )
}


def synthesis_method(name: str) -> SynthesisMethod:
    """Return the registered method called `name`.

    Parameters
    ----------
    name
        Key of `METHODS`.

    Raises
    ------
    ParameterError
        If there is no such method; lists those that there are.
    """
    try:
        return METHODS[name]
    except KeyError:
        raise ParameterError('method', name, f'must be one of {", ".join(METHODS)}') from None
