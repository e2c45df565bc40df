"""The whole loop: runner, recorder, reports, dashboard."""

import dvs_common as dvs_common
