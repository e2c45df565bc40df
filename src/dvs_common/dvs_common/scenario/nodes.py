"""Names of the loop's nodes: the executables, and the nodes unless they are remapped."""

from __future__ import annotations

PLANT = 'plant_sim'
CAMERA = 'event_camera'
CONTROLLER = 'hinf_controller'

NODES = (PLANT, CAMERA, CONTROLLER)
