"""What concerns the camera alone: its pixels in detail, their imperfections and its pictures."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.scenario.fields import ParameterGroup, parameter
from dvs_common.scenario.nodes import CAMERA
from dvs_common.scenario.presets import PRESETS
from dvs_common.scenario.schema import NON_NEGATIVE, POSITIVE, SHARE, Interval

# More is a slip, and stamps and arrays have an end.
_UP_TO_A_MILLION = Interval(low=0, high=1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraParameters(ParameterGroup):
    """Input, pixels and streams of the camera."""

    log_floor: float = parameter(
        0.0,
        'With log, luminosity below which a pixel makes no difference; 0: y <= 0 is an error. '
        'Integer images are floored at half a grey level in any case',
        nodes=(CAMERA,),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    lin_log_knee: float = parameter(
        20.0,
        'With lin_log, luminosity up to which the photoreceptor is linear',
        nodes=(CAMERA,),
        unit='luminosity',
        interval=Interval(low=1, low_open=True),
    )
    interpolation: str = parameter(
        'linear_log',
        'Course of the level between two samples, which dates the events: linear, or a '
        'monotone cubic through the last four samples',
        nodes=(CAMERA,),
        choices=('linear_log', 'hermite'),
    )
    label_noise: bool = parameter(
        False,
        'Publish events_label: the events with a field that marks noise (1) and signal (0)',
        nodes=(CAMERA,),
    )
    keyframe_period: float = parameter(
        1.0,
        'Time of the samples between two keyframes, which hold the state of every pixel; 0: '
        'only at a start',
        nodes=(CAMERA,),
        unit='s',
        interval=_UP_TO_A_MILLION,
    )
    frame_rate: float = parameter(
        0.0,
        'Absolute measurements of the luminosity on anchor, as a sensor with frames gives them; '
        '0: none',
        nodes=(CAMERA,),
        unit='1/s',
        interval=_UP_TO_A_MILLION,
    )
    frame_noise: float = parameter(
        0.0,
        'Standard deviation of the relative error of every pixel in these measurements, normal '
        'and cut off at three of them',
        nodes=(CAMERA,),
        interval=Interval(low=0, high=0.3),
    )
    region: tuple[int, ...] = parameter(
        (),
        'Part of the images that the pixels see: left column, upper row, width and height; empty: '
        'all',
        nodes=(CAMERA,),
        unit='pixels',
        interval=Interval(low=0, high=65535),
    )
    binning: int = parameter(
        1,
        'Columns, and rows, of the square of image pixels whose mean luminosity one pixel sees',
        nodes=(CAMERA,),
        unit='pixels',
        interval=Interval(low=1, high=65535),
    )
    masked_pixels: tuple[int, ...] = parameter(
        (),
        'Image pixels x, y, x, y, ... that nothing is taken from: a pixel that sees only such '
        'keeps its first luminosity',
        nodes=(CAMERA,),
        interval=Interval(low=0, high=65535),
    )
    threads: int = parameter(
        1,
        'Threads that share the rows of a large pixel array: the same events, sooner',
        nodes=(CAMERA,),
        interval=Interval(low=1, high=64),
    )
    compressed_input: bool = parameter(
        False,
        'Take sensor_msgs/CompressedImage on luminosity/compressed instead of luminosity; '
        'needs OpenCV or Pillow',
        nodes=(CAMERA,),
    )
    image_reliability: str = parameter(
        'reliable',
        'QoS of the image input: best_effort also receives from drivers that offer no more',
        nodes=(CAMERA,),
        choices=('reliable', 'best_effort'),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ImperfectionParameters(ParameterGroup):
    """In what the pixels differ from ideal ones."""

    preset: str = parameter(
        'ideal',
        'Sensor that gives threshold and imperfections where they are not given themselves',
        nodes=(CAMERA,),
        choices=tuple(PRESETS),
    )
    threshold_mismatch: float = parameter(
        0.0,
        'Standard deviation of the ON and OFF thresholds of the pixels relative to h, frozen',
        nodes=(CAMERA,),
        interval=SHARE,
    )
    event_threshold_off: float = parameter(
        0.0,
        'Threshold of OFF events; 0: event_threshold, as an estimator that counts polarities '
        'takes for granted',
        nodes=(CAMERA,),
        unit='log_b units',
        interval=NON_NEGATIVE,
    )
    reset: str = parameter(
        'ladder',
        'What a reference becomes at an event: ladder moves it by the threshold, level takes the '
        "present level, as the sensor's circuit does",
        nodes=(CAMERA,),
        choices=('ladder', 'level'),
    )
    refractory_period: float = parameter(
        0.0,
        'Time after an event in which a pixel fires no other; its reference waits, so that no '
        'polarity is lost',
        nodes=(CAMERA,),
        unit='s',
        interval=_UP_TO_A_MILLION,
    )
    leak_rate: float = parameter(
        0.0,
        'ON events of a pixel in constant light',
        nodes=(CAMERA,),
        unit='1/s',
        interval=_UP_TO_A_MILLION,
    )
    shot_noise_rate: float = parameter(
        0.0,
        'Spurious events of a pixel, ON and OFF alike; its reference moves with them',
        nodes=(CAMERA,),
        unit='1/s',
        interval=_UP_TO_A_MILLION,
    )
    shot_noise_luminosity: float = parameter(
        0.0,
        'Luminosity at which a quarter of the shot noise is left, linearly less on the way '
        'there; 0: the same rate everywhere',
        nodes=(CAMERA,),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    cutoff_frequency: float = parameter(
        0.0,
        "Corner of the photoreceptor's first-order low-pass; 0: none",
        nodes=(CAMERA,),
        unit='Hz',
        interval=NON_NEGATIVE,
    )
    cutoff_luminosity: float = parameter(
        0.0,
        'Luminosity below which the corner falls in proportion, down to a tenth; 0: the same '
        'corner everywhere',
        nodes=(CAMERA,),
        unit='luminosity',
        interval=NON_NEGATIVE,
    )
    hot_pixel_fraction: float = parameter(
        0.0,
        'Share of pixels that leak at hot_pixel_rate',
        nodes=(CAMERA,),
        interval=SHARE,
    )
    hot_pixel_rate: float = parameter(
        100.0,
        'ON events of a hot pixel',
        nodes=(CAMERA,),
        unit='1/s',
        interval=_UP_TO_A_MILLION,
    )
    dead_pixel_fraction: float = parameter(
        0.0,
        'Share of pixels that never fire',
        nodes=(CAMERA,),
        interval=SHARE,
    )
    latency: float = parameter(
        0.0,
        'Delay from a crossing to the stamp of its event',
        nodes=(CAMERA,),
        unit='s',
        interval=_UP_TO_A_MILLION,
    )
    jitter: float = parameter(
        0.0,
        'Standard deviation of the delay; a delay is never negative',
        nodes=(CAMERA,),
        unit='s',
        interval=_UP_TO_A_MILLION,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayParameters(ParameterGroup):
    """The picture `event_image`."""

    display_rate: float = parameter(
        25.0,
        'Rate of event_image in the time of the samples, while it has a subscriber',
        nodes=(CAMERA,),
        unit='Hz',
        interval=Interval(low=0.001, high=1000000.0),
        dynamic=True,
    )
    display_style: str = parameter(
        'time_slice',
        'event_image: net polarity since the last image, or an exponentially decaying surface',
        nodes=(CAMERA,),
        choices=('time_slice', 'surface'),
        dynamic=True,
    )
    display_decay: float = parameter(
        0.05,
        'Time constant of the decaying surface',
        nodes=(CAMERA,),
        unit='s',
        interval=POSITIVE,
        dynamic=True,
    )
    display_palette: str = parameter(
        'red_blue',
        'Colours of ON and OFF on dark ground; orange and blue are told apart by every kind '
        'of colour vision',
        nodes=(CAMERA,),
        choices=('red_blue', 'orange_blue'),
        dynamic=True,
    )
