"""Zero-order-hold estimator and H-infinity / mu / peak-to-peak controller on polarity events."""

import dvs_common as dvs_common
