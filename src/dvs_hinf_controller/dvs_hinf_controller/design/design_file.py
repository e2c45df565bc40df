"""A design as a JSON file, refused where it was made for another problem."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dvs_common.arrays import FloatArray
from dvs_common.errors import ParameterError
from dvs_common.scenario.model import PixelScene
from dvs_common.writing import write_text
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.problem import DesignProblem

SCHEMA_VERSION = 1
_RTOL = 1e-9
_FINGERPRINT_WAVES = (0.0, 0.7390851332151607, 1.4142135623730951, 2.718281828459045)


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredDesign:
    """What a design file holds.

    Parameters
    ----------
    path
        Where it was read.
    method
        Name of the method that found the controller.
    controller
        K on the mean of zbar.
    identity
        Plant, set-point and pixel set that it was made for.
    seconds
        Time that the synthesis took, s.
    """

    path: Path
    method: str
    controller: LinearController
    identity: Mapping[str, Mapping[str, Any]]
    seconds: float

    def require_made_for(self, problem: DesignProblem) -> None:
        """Raise `ParameterError` naming what differs, if it was made for another problem.

        Parameters
        ----------
        problem
            Problem at hand.
        """
        names = {'plant': 'plant', 'set_point': 'set-point', 'pixels': 'pixel set'}
        for key, wanted in _identity(problem).items():
            for field, value in wanted.items():
                if not _same(self.identity[key].get(field), value):
                    raise ParameterError(
                        'design_file',
                        self.path,
                        f'holds a design for another {names[key]} ({field} differs)',
                    )


def write_design_file(
    path: str | Path,
    *,
    method: str,
    problem: DesignProblem,
    controller: LinearController,
    figures: Mapping[str, Any],
) -> None:
    """Write a design: schema version, problem, matrices with every digit, figures.

    Parameters
    ----------
    path
        File to write.
    method
        Name of the method.
    problem
        Problem that it answers.
    controller
        K.
    figures
        Figures by name, for the reader.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    document = {
        'schema_version': SCHEMA_VERSION,
        'method': method,
        'problem': _identity(problem),
        'tolerance': problem.tolerance,
        'log_base': problem.log_base,
        'controller': controller_fields(controller),
        'figures': finite_or_null(figures),
    }
    write_text(path, json.dumps(document, indent=1) + '\n')


def read_design_file(path: str | Path) -> StoredDesign:
    """Read a design file.

    Parameters
    ----------
    path
        File written by `write_design_file`.

    Raises
    ------
    ParameterError
        If it cannot be read, is no design, or has another schema version.
    """
    try:
        document = json.loads(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError('design_file', path, f'cannot be read: {error.strerror}') from None
    except (ValueError, RecursionError) as error:
        raise ParameterError('design_file', path, f'is not JSON: {error}') from None
    version = document.get('schema_version') if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        raise ParameterError(
            'design_file', path, f'has schema_version {version}, must be {SCHEMA_VERSION}'
        )
    try:
        return StoredDesign(
            path=Path(path),
            method=str(document['method']),
            controller=controller_of(document['controller']),
            identity={key: dict(document['problem'][key]) for key in _IDENTITY_KEYS},
            seconds=float(document['figures']['seconds']),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ParameterError('design_file', path, f'is no design: {error!r}') from None


def controller_fields(controller: LinearController) -> dict[str, Any]:
    """Matrices of a controller with every digit.

    Parameters
    ----------
    controller
        K.
    """
    return {
        'state_matrix': controller.state_matrix.tolist(),
        'input_vector': controller.input_vector.tolist(),
        'output_matrix': controller.output_matrix.tolist(),
        'feedthrough': controller.feedthrough.tolist(),
    }


def controller_of(fields: Mapping[str, Any]) -> LinearController:
    """Controller of its fields.

    Parameters
    ----------
    fields
        What `controller_fields` returns.

    Raises
    ------
    KeyError, TypeError, ValueError, ParameterError
        If they are none.
    """
    vector = np.array(fields['input_vector'], dtype=np.float64)
    feedthrough = np.array(fields['feedthrough'], dtype=np.float64)
    k, m = len(vector), len(feedthrough)
    return LinearController(
        state_matrix=np.array(fields['state_matrix'], dtype=np.float64).reshape(k, k),
        input_vector=vector.reshape(k, *feedthrough.shape[1:]),
        output_matrix=np.array(fields['output_matrix'], dtype=np.float64).reshape(m, k),
        feedthrough=feedthrough,
    )


def finite_or_null(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures with None for infinity and NaN, which JSON does not have.

    Parameters
    ----------
    figures
        Figures by name.
    """
    return {name: _finite(value) for name, value in figures.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return finite_or_null(value)
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_IDENTITY_KEYS = ('plant', 'set_point', 'pixels')


def _identity(problem: DesignProblem) -> dict[str, dict[str, Any]]:
    model, scene = problem.model, problem.scene
    groups = {} if scene.groups is None else {'groups': scene.groups.tolist()}
    return {
        'plant': {
            'state_matrix': model.state_matrix.tolist(),
            'input_matrix': model.input_matrix.tolist(),
            'output_vector': model.output_vector.tolist(),
        },
        'set_point': {'state': problem.equilibrium.state.tolist()},
        'pixels': {
            'height': scene.height,
            'width': scene.width,
            'fingerprint': _fingerprint(scene).tolist(),
            **groups,
        },
    }


def _fingerprint(scene: PixelScene) -> FloatArray:
    """Means of the offsets under fixed waves: tell pixel sets apart, bear rounding errors."""
    pixel = np.arange(scene.pixel_count)
    offsets = scene.brightness_offsets
    return np.array([float(np.mean(offsets * np.cos(w * pixel))) for w in _FINGERPRINT_WAVES])


def _same(stored: object, wanted: object) -> bool:
    try:
        a, b = np.asarray(stored, dtype=np.float64), np.asarray(wanted, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    scale = float(np.max(np.abs(b), initial=0.0))
    return a.shape == b.shape and bool(np.all(np.abs(a - b) <= _RTOL * scale))
