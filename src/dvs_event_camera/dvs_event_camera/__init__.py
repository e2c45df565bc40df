"""An event camera (DVS): luminosity or images in, events with exact stamps and polarities out.

Examples
--------
Four pixels; after a millisecond two are brighter and one is darker:

>>> import numpy as np
>>> from dvs_event_camera import Imperfections, PixelArray
>>> pixels = PixelArray(event_threshold=0.15)
>>> len(pixels.update(0, np.full(4, 100.0)))  # the first sample sets the references
0
>>> events = pixels.update(1_000_000, [100, 120, 150, 80])  # 1 ms later
>>> list(zip(events.t.tolist(), events.pixel.tolist(), events.polarity.tolist()))
[(369946, 2, 1), (672214, 3, -1), (739892, 2, 1), (822723, 1, 1)]

A real sensor also fires in constant light:

>>> noisy = Imperfections(leak_rate=0.1, shot_noise_rate=1.0)
>>> pixels = PixelArray(event_threshold=0.15, imperfections=noisy, label_noise=True, seed=1)
>>> len(pixels.update(0, np.full(100, 100.0)))
0
>>> events = pixels.update(10**9, np.full(100, 100.0))
>>> bool(len(events) > 100), bool(events.noise.all())
(True, True)
"""

from __future__ import annotations

from dvs_common.lazy import lazy_exports

__getattr__, __all__ = lazy_exports(__name__, __file__)
