"""Event camera (DVS): luminosity or images in, precisely stamped polarity events out."""

import dvs_common as dvs_common
