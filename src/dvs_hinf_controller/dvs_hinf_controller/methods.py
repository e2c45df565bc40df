"""The synthesis methods by name; users add their own to the registry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dvs_hinf_controller.certified import synthesize_certified
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.options import DesignOptions
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.rolled_off import synthesize_rolled_off
from dvs_hinf_controller.structured import synthesize_structured
from dvs_interfaces.errors import ParameterError


class SynthesisMethod(Protocol):
    """A way to find a controller; what it promises is measured afterwards."""

    @property
    def name(self) -> str:
        """Name by which the user asks for it."""

    def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
        """Find a controller K on the mean of zbar.

        Parameters
        ----------
        problem
            What is asked.
        options
            What may be paid.

        Raises
        ------
        SynthesisError
            If there is none; names the assumption that fails.
        """


@dataclass(frozen=True, slots=True)
class Unstructured:
    """Minimise ``sup_w ||G(jw)||``: H-infinity synthesis (paper, section IV.A).

    Parameters
    ----------
    name
        Name of the method, as in the parameter `method`.
    """

    name: str = 'unstructured'

    def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
        """Find a controller K on the mean of zbar.

        Parameters
        ----------
        problem
            Its plant alone matters.
        options
            Slack, bandwidth limit, process noise.

        Raises
        ------
        SynthesisError
            If there is none; names the assumption that fails.
        """
        return synthesize_rolled_off(problem.model, options).controller


@dataclass(frozen=True, slots=True)
class Structured:
    """Minimise ``mu = sup_w (|T| + ||G||)``: the sector as it is (paper, section IV.A).

    Parameters
    ----------
    name
        Name of the method, as in the parameter `method`.
    """

    name: str = 'structured'

    def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
        """Find a controller K on the mean of zbar.

        Parameters
        ----------
        problem
            Its plant alone matters.
        options
            Slack, bandwidth limit, process noise.

        Raises
        ------
        SynthesisError
            If there is none; names the assumption that fails.
        """
        return synthesize_structured(problem.model, options)


@dataclass(frozen=True, slots=True)
class Certified:
    """Maximise h_certified: peak-to-peak design (docs/theory.md, "A guarantee").

    Parameters
    ----------
    name
        Name of the method, as in the parameter `method`.
    """

    name: str = 'certified'

    def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
        """Find a controller K on the mean of zbar.

        Parameters
        ----------
        problem
            Plant, luminosities and tolerance.
        options
            Bandwidth limit.

        Raises
        ------
        SynthesisError
            If there is none; names the assumption that fails.
        """
        return synthesize_certified(problem, options)


METHODS: dict[str, SynthesisMethod] = {
    method.name: method for method in (Unstructured(), Structured(), Certified())
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
