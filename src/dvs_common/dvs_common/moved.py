"""Modules that were rearranged: their old names still import, with a DeprecationWarning.

A script that was written for the modules of version 0.1.0 goes on working. The finder comes last
in the import system, so a module that exists is never replaced.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    # It loads tempfile, with shutil and all compression.
    from importlib.abc import Loader

# Old package, new package, and the modules that kept their own name.
_ROOMS = """
dvs_closed_loop dvs_closed_loop.bags bag bag_recorder_node bag_storage recorded_run recording
dvs_closed_loop dvs_closed_loop.bags streams
dvs_closed_loop dvs_closed_loop.commands dashboard latency play record report
dvs_closed_loop dvs_closed_loop.dashboard dashboard_node dashboard_server live_view
dvs_closed_loop dvs_closed_loop.reports report_page
dvs_closed_loop dvs_closed_loop.running closed_loop composed_loop launch_plan loop_parameters
dvs_closed_loop dvs_closed_loop.running loop_plan loop_progress
dvs_closed_loop dvs_closed_loop.running loop_runner processes run_recorder
dvs_closed_loop dvs_common.wire index_watch
dvs_closed_loop dvs_common output_folder
dvs_closed_loop dvs_simulation exact paper plotting sweep
dvs_closed_loop dvs_simulation.judging figure trace verdict
dvs_closed_loop dvs_simulation.sampled sampled_loop
dvs_closed_loop.commands dvs_simulation.commands reproduce_paper simulate sweep
dvs_closed_loop.exact dvs_simulation.exact automaton compilation loop modes
dvs_closed_loop.exact dvs_simulation.exact run_figure signals trajectory
dvs_closed_loop.paper dvs_simulation.paper animation corrections counterexample experiments figures
dvs_closed_loop.paper dvs_simulation.paper published report
dvs_closed_loop.paper dvs_simulation.paper reproduce story table
dvs_closed_loop.sweep dvs_simulation.sweep certificate pixels random_loops runner study
dvs_closed_loop.sweep dvs_simulation.sweep sweep_figures table threshold
dvs_event_camera dvs_event_camera.pixels comparators compiled crossings delay_line
dvs_event_camera dvs_event_camera.pixels hermite
dvs_event_camera dvs_event_camera.pixels imperfect_comparator imperfections level_stages
dvs_event_camera dvs_event_camera.pixels photoreceptor pixel_array
dvs_event_camera dvs_event_camera.pixels pixel_events references signed_crossings silent_band
dvs_event_camera dvs_event_camera.streams event_packet event_records
dvs_event_camera dvs_event_camera.streams image_source renderer
dvs_event_camera dvs_event_camera.tools event_show packet_bridge_node scene_node scenes
dvs_event_camera dvs_event_camera.tools show_events show_events_node stream_statistics
dvs_hinf_controller dvs_hinf_controller.analysis hinf_norm mu peak_gain sampling sector thresholds
dvs_hinf_controller dvs_hinf_controller.design bode_figure design design_file design_report
dvs_hinf_controller dvs_hinf_controller.design design_tool start_up
dvs_hinf_controller dvs_hinf_controller.running event_controller held_input
dvs_hinf_controller dvs_hinf_controller.synthesis certified full_plant hinf_synthesis methods
dvs_hinf_controller dvs_hinf_controller.synthesis options riccati rolled_off
dvs_hinf_controller dvs_hinf_controller.synthesis structured synthesis_error weight_fit youla
dvs_interfaces dvs_common errors
dvs_interfaces dvs_common.node demanded_publisher health launching managed_node node_plan
dvs_interfaces dvs_common.node ros_parameters spin
dvs_interfaces dvs_common.scenario model parameters reference_bounds scenario schema
dvs_interfaces dvs_common.wire cdr events keyframe messages stamped topics
"""
_RENAMED = {
    'dvs_closed_loop.exact.kernel': 'dvs_simulation.exact.kernel.run',
    'dvs_closed_loop.exact.layout': 'dvs_simulation.exact.kernel.layout',
    'dvs_event_camera.pixels.kernel_cache': 'dvs_common.kernel_cache',
    'dvs_event_camera.crossings_numba': 'dvs_event_camera.pixels.pixel_kernels',
    'dvs_closed_loop.bag_recorder_node': 'dvs_closed_loop.bags.bag_recorder',
    'dvs_closed_loop.dashboard_node': 'dvs_closed_loop.dashboard.dashboard_listener',
    'dvs_closed_loop.tool_node': 'dvs_closed_loop.running.tool',
    'dvs_hinf_controller.reduced': 'dvs_hinf_controller.synthesis.one_pixel_plant',
    'dvs_hinf_controller.reduction': 'dvs_hinf_controller.synthesis.order_reduction',
    'dvs_plant_sim.lockstep_node': 'dvs_plant_sim.lockstep_driver',
    'dvs_plant_sim.realtime_node': 'dvs_plant_sim.realtime_driver',
}


def _moved() -> Iterator[tuple[str, str]]:
    for line in _ROOMS.strip().splitlines():
        old, new, *names = line.split()
        yield from ((f'{old}.{name}', f'{new}.{name}') for name in names)


MOVED: Mapping[str, str] = {**dict(_moved()), **_RENAMED}


class _Alias:
    """Puts the module of the new name under the old one."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module of the new name."""
        new = MOVED[spec.name]
        warnings.warn(f'{spec.name} is now {new}', DeprecationWarning, stacklevel=2)
        self._module = import_module(new)
        self._spec = self._module.__spec__
        return self._module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module back the spec of its new name, which the import system replaced."""
        module.__spec__ = self._spec


class _MovedFinder:
    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """Spec of a module that was moved, None for any other."""
        return ModuleSpec(fullname, cast('Loader', _Alias())) if fullname in MOVED else None


def install() -> None:
    """Let old names import; harmless when repeated."""
    if not any(isinstance(finder, _MovedFinder) for finder in sys.meta_path):
        sys.meta_path.append(_MovedFinder())
