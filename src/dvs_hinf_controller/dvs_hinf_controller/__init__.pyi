from dvs_hinf_controller.analysis.hinf_norm import HinfNorm, hinf_norm
from dvs_hinf_controller.analysis.mu import MuBounds, mu_bounds
from dvs_hinf_controller.analysis.peak_gain import PeakGains, peak_gains
from dvs_hinf_controller.analysis.sampling import max_sampling_period
from dvs_hinf_controller.analysis.sector import Sector
from dvs_hinf_controller.controller import LinearController
from dvs_hinf_controller.design.design import (
    Design,
    DesignFigures,
    design_controller,
    design_from_scenario,
    load_design,
    save_design,
)
from dvs_hinf_controller.problem import DesignProblem
from dvs_hinf_controller.running.event_controller import EventController
from dvs_hinf_controller.state_space import StateSpace, state_response
from dvs_hinf_controller.synthesis.methods import SynthesisMethod
from dvs_hinf_controller.synthesis.options import DesignOptions
