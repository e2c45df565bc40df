"""From a problem to a design: the tool, its reports, figures and files."""

from dvs_hinf_controller.design.design import (
    Design,
    DesignFigures,
    design_controller,
    design_from_scenario,
    load_design,
    save_design,
)

__all__ = [
    'Design',
    'DesignFigures',
    'design_controller',
    'design_from_scenario',
    'load_design',
    'save_design',
]
