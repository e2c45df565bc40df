"""Where the checkout is; with its packages on the path, so that a script runs without a build."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = (
    'dvs_common',
    'dvs_plant_sim',
    'dvs_event_camera',
    'dvs_hinf_controller',
    'dvs_simulation',
)
sys.path[:0] = [str(ROOT / 'src' / package) for package in PACKAGES]
