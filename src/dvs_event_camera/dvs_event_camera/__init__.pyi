from dvs_event_camera.event_camera import EventCamera, Exposure
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import (
    LinLogPhotoreceptor,
    LogPhotoreceptor,
    Photoreceptor,
    SignedLogPhotoreceptor,
)
from dvs_event_camera.pixels.pixel_array import PixelArray
from dvs_event_camera.pixels.pixel_events import PixelEvents as Events
from dvs_event_camera.streams.image_source import LuminosityFrame
