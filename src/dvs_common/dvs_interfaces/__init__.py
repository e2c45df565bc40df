"""Former name of `dvs_common`; its modules are found where they went (`dvs_common.moved`)."""

import dvs_common as dvs_common
