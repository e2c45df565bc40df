"""What all packages share: wire contract, scenario, base of the nodes."""

from dvs_common import moved

moved.install()
