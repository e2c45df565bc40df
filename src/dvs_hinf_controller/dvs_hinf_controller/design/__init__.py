"""From a problem to a design: the tool, its reports, figures and files."""

from dvs_hinf_controller.design.design import Design, design_controller, design_from_scenario

__all__ = ['Design', 'design_controller', 'design_from_scenario']
