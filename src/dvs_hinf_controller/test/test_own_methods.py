"""Synthesis methods of users: registered in Python, or by an installed package."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dvs_common.errors import ParameterError
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import design_controller
from dvs_hinf_controller.design.design_tool import main
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.synthesis.methods import ENTRY_POINTS, METHODS
from dvs_hinf_controller.synthesis.options import DesignOptions

Make = Callable[..., DesignProblem]


def test_users_method_is_registered(paper_problem: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    class Mine:
        name = 'mine'

        def synthesize(self, problem: DesignProblem, options: DesignOptions) -> LinearController:
            return METHODS['unstructured'].synthesize(problem, options)

    monkeypatch.setitem(METHODS, 'mine', Mine())
    assert design_controller(paper_problem(1), method='mine').figures.gamma < 1.97


@pytest.fixture
def register(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Return what installs a package of one module that registers the method `mine`."""

    def install(source: str, loads: str = 'my_method:Mine') -> None:
        (tmp_path / 'my_method.py').write_text(source)
        monkeypatch.delitem(sys.modules, 'my_method', raising=False)
        info = tmp_path / 'my_method-1.0.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_method\nVersion: 1.0\n')
        (info / 'entry_points.txt').write_text(f'[{ENTRY_POINTS}]\nmine = {loads}\n')
        monkeypatch.syspath_prepend(tmp_path)

    return install


OWN_METHOD = """
from dvs_hinf_controller.synthesis.methods import METHODS

class Mine:
    name = 'mine'
    synthesize = METHODS['unstructured'].synthesize
"""


def test_a_method_that_an_installed_package_registers_designs_like_any_other(
    register: Callable[..., None], params_file: Path, capsys: Any
) -> None:
    register(OWN_METHOD)

    assert main(['--params-file', str(params_file), '--method', 'mine', '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['method'] == 'mine'
    assert figures['gamma'] == pytest.approx(1.9567, rel=2e-3)
    assert main(['--params-file', str(params_file), '--method', 'yours']) == 2
    assert (
        'method = yours: must be one of unstructured, structured, certified, mine, file'
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ('source', 'loads', 'reason'),
    [
        ('import no_such_module', 'my_method:Mine', "No module named 'no_such_module'"),
        ('', 'my_method:Mine', "has no attribute 'Mine'"),
        ('Mine = 3', 'my_method:Mine', 'has no synthesize'),
    ],
)
def test_a_registered_method_that_is_none_is_refused_by_name(
    register: Callable[..., None], paper_problem: Make, source: str, loads: str, reason: str
) -> None:
    register(source, loads)

    with pytest.raises(ParameterError, match=f'method = mine: .* {loads}.*{reason}'):
        design_controller(paper_problem(1), method='mine')
