"""The table of all parameters of the suite; the defaults are the scenario ``mirror_r3``."""

from __future__ import annotations

from dvs_common.scenario.schema import (
    NON_NEGATIVE,
    POSITIVE,
    Interval,
    Kind,
    ParameterSpec,
    Schema,
)

PLANT = 'plant_sim'
CAMERA = 'event_camera'
CONTROLLER = 'hinf_controller'

_PLANT = frozenset({PLANT})
_CAMERA = frozenset({CAMERA})
_CONTROLLER = frozenset({CONTROLLER})
_LOOP = frozenset({PLANT, CONTROLLER})
_PIXELS = frozenset({CAMERA, CONTROLLER})
_ALL = frozenset({PLANT, CAMERA, CONTROLLER})

# Nobody means more, and stamps and arrays have an end.
_SECONDS = Interval(low=0, high=1e6)
_NOISE_RATE = Interval(low=0, high=1e6)

_MODEL = (
    ParameterSpec(
        name='state_matrix',
        kind=Kind.FLOATS,
        default=(2.0, 10.0, 0.0, 5.0),
        unit='1/s',
        nodes=_LOOP,
        description='State matrix A, n x n, row-major (paper, eq. 1)',
    ),
    ParameterSpec(
        name='input_matrix',
        kind=Kind.FLOATS,
        default=(1.0, 1.0),
        nodes=_LOOP,
        description='Input matrix B, n x m, row-major (paper, eq. 1)',
    ),
    ParameterSpec(
        name='output_vector',
        kind=Kind.FLOATS,
        default=(0.894427190999916, 0.447213595499958),
        nodes=_LOOP,
        description='Output vector c, n entries: gradient of the brightness (paper, eq. 1)',
    ),
    ParameterSpec(
        name='pixel_offsets',
        kind=Kind.FLOATS,
        default=(0.0, 0.0, 0.01, 0.0, -0.01, 0.0),
        nodes=_LOOP,
        description='Pixel displacements dx, r x n, row-major over the array (paper, eq. 1); '
        'unused where there is a pixel_pitch',
    ),
    ParameterSpec(
        name='pixel_pitch',
        kind=Kind.FLOATS,
        default=(),
        nodes=_LOOP,
        description='Displacement from a column to the next and from a row to the next, 2 x n, '
        'row-major: a regular grid in place of pixel_offsets',
    ),
    ParameterSpec(
        name='pixel_origin',
        kind=Kind.FLOATS,
        default=(),
        nodes=_LOOP,
        description='Displacement of the centre of the grid of pixel_pitch, n entries (empty: 0); '
        'along c it is a brightness offset',
    ),
    ParameterSpec(
        name='pixel_grid',
        kind=Kind.INTS,
        default=(1, 3),
        unit='pixels',
        nodes=_LOOP,
        interval=Interval(low=1, high=65535),
        description='Rows and columns [height, width] of the pixel array; height x width = r',
    ),
    ParameterSpec(
        name='initial_state',
        kind=Kind.FLOATS,
        default=(0.4821, 0.1572),
        nodes=_LOOP,
        description='Initial state x0 in original coordinates, n entries (paper, section IV)',
    ),
    ParameterSpec(
        name='set_point',
        kind=Kind.FLOATS,
        default=(0.2321, -0.0928),
        nodes=_LOOP,
        dynamic=True,
        description='Set-point x_d, n entries (paper, eq. 2)',
    ),
    ParameterSpec(
        name='set_point_tolerance',
        kind=Kind.FLOAT,
        default=1e-3,
        nodes=_LOOP,
        interval=NON_NEGATIVE,
        description='Largest accepted residual ||(I - B B^+) A x_d||; within it the nearest '
        'stabilizable point is used',
    ),
    ParameterSpec(
        name='tolerance',
        kind=Kind.FLOAT,
        default=0.05,
        nodes=_LOOP,
        interval=POSITIVE,
        dynamic=True,
        description='Tolerance eps: limsup ||x - x_d|| must stay below it (paper, Problem 1)',
    ),
)

_SENSOR = (
    ParameterSpec(
        name='event_threshold',
        kind=Kind.FLOAT,
        default=0.15,
        unit='log_b units',
        nodes=_PIXELS,
        interval=POSITIVE,
        dynamic=True,
        description='Event threshold h (paper, eq. 5)',
    ),
    ParameterSpec(
        name='log_base',
        kind=Kind.FLOAT,
        default=2.718281828459045,
        nodes=_PIXELS,
        interval=Interval(low=1, low_open=True),
        description='Base b of the logarithm (paper, eq. 6)',
    ),
    ParameterSpec(
        name='reference_lower',
        kind=Kind.FLOATS,
        default=(),
        unit='luminosity',
        nodes=_PIXELS,
        interval=POSITIVE,
        description='Lower bounds m_i of the initial references, 1 or r entries (paper, A1); '
        'empty: from reference_uncertainty',
    ),
    ParameterSpec(
        name='reference_upper',
        kind=Kind.FLOATS,
        default=(),
        unit='luminosity',
        nodes=_PIXELS,
        interval=POSITIVE,
        description='Upper bounds M_i of the initial references, 1 or r entries (paper, A1); '
        'empty: from reference_uncertainty',
    ),
    ParameterSpec(
        name='reference_uncertainty',
        kind=Kind.FLOAT,
        default=0.002,
        unit='luminosity',
        nodes=_PIXELS,
        interval=NON_NEGATIVE,
        description='dy: m_i, M_i = |y_i(0)| -+ dy where reference_lower and reference_upper are '
        'empty (paper, section IV)',
    ),
    ParameterSpec(
        name='initial_reference',
        kind=Kind.TEXT,
        default='luminosity',
        nodes=_CAMERA,
        choices=('luminosity', 'lower', 'upper', 'random'),
        description='Initial reference q_i(0): the first luminosity, m_i, M_i, or drawn '
        'log-uniformly between them with seed',
    ),
    ParameterSpec(
        name='photoreceptor',
        kind=Kind.TEXT,
        default='log',
        nodes=_ALL,
        choices=('log', 'lin_log', 'signed_log'),
        description='Pixel law: log of a positive luminosity, linear below a knee and log above '
        "it, or the signed log of the paper's example (no real sensor)",
    ),
    ParameterSpec(
        name='dead_band',
        kind=Kind.FLOAT,
        default=1e-4,
        unit='luminosity',
        nodes=_ALL,
        interval=POSITIVE,
        description='With signed_log, |y| below which a pixel is silent (paper, Remark 5)',
    ),
)

_RUN = (
    ParameterSpec(
        name='plant_executable',
        kind=Kind.TEXT,
        default='dvs_plant_sim/plant_sim',
        description='Plant node that tools start for this scenario: package/executable, or the '
        'path of a program (./my_plant.py is relative to the parameter file)',
    ),
    ParameterSpec(
        name='mode',
        kind=Kind.TEXT,
        default='lockstep',
        nodes=_ALL,
        choices=('lockstep', 'realtime'),
        description='lockstep: sample k waits for command k, reproducible to the byte; realtime: '
        'wall clock',
    ),
    ParameterSpec(
        name='sampling_period',
        kind=Kind.FLOAT,
        default=1e-3,
        unit='s',
        nodes=_LOOP,
        interval=Interval(low=1e-6, high=1.0),
        description='Period of luminosity samples and commands, rounded to the nanosecond',
    ),
    ParameterSpec(
        name='duration',
        kind=Kind.FLOAT,
        default=6.0,
        unit='s',
        nodes=_PLANT,
        interval=Interval(low=0, high=2**31 - 1),
        description='Length of the run in simulated time; 0: for ever',
    ),
    ParameterSpec(
        name='real_time_factor',
        kind=Kind.FLOAT,
        default=0.0,
        nodes=_PLANT,
        interval=NON_NEGATIVE,
        dynamic=True,
        description='Simulated seconds per wall-clock second in lockstep; 0: as fast as the '
        'machine allows',
    ),
    ParameterSpec(
        name='seed',
        kind=Kind.INT,
        default=0,
        nodes=frozenset({PLANT, CAMERA}),
        interval=Interval(low=0, high=2**63 - 1),
        description='Seed of every random draw',
    ),
    ParameterSpec(
        name='autostart',
        kind=Kind.BOOL,
        default=True,
        nodes=_ALL,
        description='Configure and activate by itself; otherwise wait for lifecycle transitions',
        read_only=True,
    ),
)

_DISTURBANCE = (
    ParameterSpec(
        name='input_disturbance',
        kind=Kind.FLOAT,
        default=0.0,
        unit='input',
        nodes=_PLANT,
        interval=NON_NEGATIVE,
        description='Standard deviation of Gaussian noise on every input, held for a sampling '
        'period',
    ),
    ParameterSpec(
        name='state_disturbance',
        kind=Kind.FLOAT,
        default=0.0,
        unit='state/sqrt(s)',
        nodes=_PLANT,
        interval=NON_NEGATIVE,
        description='Intensity of a Gaussian random walk added to every state',
    ),
    ParameterSpec(
        name='nonphysical_luminosity',
        kind=Kind.TEXT,
        default='stop',
        nodes=_PLANT,
        choices=('stop', 'clamp', 'publish'),
        description='What the plant does when y <= 0 meets a physical pixel: end the run with an '
        'error, publish dead_band instead, or publish y as it is',
    ),
    ParameterSpec(
        name='command_timeout',
        kind=Kind.FLOAT,
        default=0.1,
        unit='s',
        nodes=_PLANT,
        interval=POSITIVE,
        description='Age at which a command is stale in realtime mode; in lockstep, time after '
        'which a missing partner is named',
    ),
    ParameterSpec(
        name='stale_command',
        kind=Kind.TEXT,
        default='hold',
        nodes=_PLANT,
        choices=('hold', 'equilibrium', 'stop'),
        description='Realtime answer to a stale command: hold it, apply -B^+ A x_d or end the run',
    ),
)

_CONTROL = (
    ParameterSpec(
        name='method',
        kind=Kind.TEXT,
        default='unstructured',
        nodes=_CONTROLLER,
        choices=('unstructured', 'structured', 'certified', 'file'),
        description='Controller K: least H-infinity norm or least mu (paper, Remark 2), largest '
        'certified threshold, or read from design_file',
    ),
    ParameterSpec(
        name='design_file',
        kind=Kind.TEXT,
        default='',
        nodes=_CONTROLLER,
        description='Design saved by design_controller --output; only with method: file',
    ),
    ParameterSpec(
        name='gamma_slack',
        kind=Kind.FLOAT,
        default=1.5e-3,
        nodes=_CONTROLLER,
        interval=Interval(low=1e-6, high=10.0),
        description='Relative excess over the least norm that may be paid for a slower controller',
    ),
    ParameterSpec(
        name='bandwidth_limit',
        kind=Kind.FLOAT,
        default=0.0,
        unit='rad/s',
        nodes=_CONTROLLER,
        interval=NON_NEGATIVE,
        description='Largest roll-off frequency of the loop; 0: no limit',
    ),
    ParameterSpec(
        name='process_noise',
        kind=Kind.FLOAT,
        default=1e-2,
        nodes=_CONTROLLER,
        interval=Interval(low=1e-6, high=10.0),
        description='Noise on the state that regularises the synthesis, relative to the rate of '
        'the plant (paper, Remark 6)',
    ),
    ParameterSpec(
        name='command_limit',
        kind=Kind.FLOATS,
        default=(),
        unit='input',
        nodes=_CONTROLLER,
        interval=POSITIVE,
        description='Largest |u_o| of every input, 1 or m entries; empty: no limit',
    ),
)

_CAMERA_EXTRAS = (
    ParameterSpec(
        name='log_floor',
        kind=Kind.FLOAT,
        default=0.0,
        unit='luminosity',
        nodes=_CAMERA,
        interval=NON_NEGATIVE,
        description='With log, luminosity below which a pixel sees no difference; 0: y <= 0 is an '
        'error. Integer images are floored at half a grey level in any case',
    ),
    ParameterSpec(
        name='lin_log_knee',
        kind=Kind.FLOAT,
        default=20.0,
        unit='luminosity',
        nodes=_CAMERA,
        interval=Interval(low=1, low_open=True),
        description='With lin_log, luminosity up to which the photoreceptor is linear',
    ),
    ParameterSpec(
        name='interpolation',
        kind=Kind.TEXT,
        default='linear_log',
        nodes=_CAMERA,
        choices=('linear_log', 'hermite'),
        description='Course of the level between two samples, which dates the events: linear, or '
        'a monotone cubic through the last four samples',
    ),
    ParameterSpec(
        name='threshold_mismatch',
        kind=Kind.FLOAT,
        default=0.0,
        nodes=_CAMERA,
        interval=Interval(low=0, high=1),
        description='Standard deviation of the ON and OFF thresholds of the pixels relative to h, '
        'frozen',
    ),
    ParameterSpec(
        name='refractory_period',
        kind=Kind.FLOAT,
        default=0.0,
        unit='s',
        nodes=_CAMERA,
        interval=_SECONDS,
        description='Time after an event in which a pixel is silent; its reference waits, so that '
        'no polarity is lost',
    ),
    ParameterSpec(
        name='leak_rate',
        kind=Kind.FLOAT,
        default=0.0,
        unit='1/s',
        nodes=_CAMERA,
        interval=_NOISE_RATE,
        description='ON events of a pixel in constant light',
    ),
    ParameterSpec(
        name='shot_noise_rate',
        kind=Kind.FLOAT,
        default=0.0,
        unit='1/s',
        nodes=_CAMERA,
        interval=_NOISE_RATE,
        description='Spurious events of a pixel, ON and OFF alike; its reference moves with them',
    ),
    ParameterSpec(
        name='cutoff_frequency',
        kind=Kind.FLOAT,
        default=0.0,
        unit='Hz',
        nodes=_CAMERA,
        interval=NON_NEGATIVE,
        description="Corner of the photoreceptor's first-order low-pass; 0: none",
    ),
    ParameterSpec(
        name='cutoff_luminosity',
        kind=Kind.FLOAT,
        default=0.0,
        unit='luminosity',
        nodes=_CAMERA,
        interval=NON_NEGATIVE,
        description='Luminosity below which the corner falls in proportion, down to a tenth; 0: '
        'the same corner everywhere',
    ),
    ParameterSpec(
        name='hot_pixel_fraction',
        kind=Kind.FLOAT,
        default=0.0,
        nodes=_CAMERA,
        interval=Interval(low=0, high=1),
        description='Share of pixels that leak at hot_pixel_rate',
    ),
    ParameterSpec(
        name='hot_pixel_rate',
        kind=Kind.FLOAT,
        default=100.0,
        unit='1/s',
        nodes=_CAMERA,
        interval=_NOISE_RATE,
        description='ON events of a hot pixel',
    ),
    ParameterSpec(
        name='dead_pixel_fraction',
        kind=Kind.FLOAT,
        default=0.0,
        nodes=_CAMERA,
        interval=Interval(low=0, high=1),
        description='Share of pixels that never fire',
    ),
    ParameterSpec(
        name='latency',
        kind=Kind.FLOAT,
        default=0.0,
        unit='s',
        nodes=_CAMERA,
        interval=_SECONDS,
        description='Delay from a crossing to the stamp of its event',
    ),
    ParameterSpec(
        name='jitter',
        kind=Kind.FLOAT,
        default=0.0,
        unit='s',
        nodes=_CAMERA,
        interval=_SECONDS,
        description='Standard deviation of the delay; a delay is never negative',
    ),
    ParameterSpec(
        name='label_noise',
        kind=Kind.BOOL,
        default=False,
        nodes=_CAMERA,
        description='Publish events_label: the events with a field that tells noise (1) from '
        'signal (0)',
    ),
    ParameterSpec(
        name='keyframe_period',
        kind=Kind.FLOAT,
        default=1.0,
        unit='s',
        nodes=_CAMERA,
        interval=_SECONDS,
        description='Time of the samples between two keyframes, the sums of polarities of all '
        'pixels; 0: only at a start',
    ),
    ParameterSpec(
        name='display_rate',
        kind=Kind.FLOAT,
        default=25.0,
        unit='Hz',
        nodes=_CAMERA,
        interval=Interval(low=1e-3, high=1e6),
        dynamic=True,
        description='Rate of event_image in the time of the samples, while somebody looks',
    ),
    ParameterSpec(
        name='display_style',
        kind=Kind.TEXT,
        default='time_slice',
        nodes=_CAMERA,
        choices=('time_slice', 'surface'),
        dynamic=True,
        description='event_image: net polarity since the last image, or an exponentially decaying '
        'surface',
    ),
    ParameterSpec(
        name='display_decay',
        kind=Kind.FLOAT,
        default=0.05,
        unit='s',
        nodes=_CAMERA,
        interval=POSITIVE,
        dynamic=True,
        description='Time constant of the decaying surface',
    ),
    ParameterSpec(
        name='display_palette',
        kind=Kind.TEXT,
        default='red_blue',
        nodes=_CAMERA,
        choices=('red_blue', 'orange_blue'),
        dynamic=True,
        description='Colours of ON and OFF on dark ground; orange and blue are told apart by '
        'every kind of colour vision',
    ),
    ParameterSpec(
        name='compressed_input',
        kind=Kind.BOOL,
        default=False,
        nodes=_CAMERA,
        description='Take sensor_msgs/CompressedImage on luminosity/compressed instead of '
        'luminosity; needs OpenCV or Pillow',
    ),
    ParameterSpec(
        name='image_reliability',
        kind=Kind.TEXT,
        default='reliable',
        nodes=_CAMERA,
        choices=('reliable', 'best_effort'),
        description='QoS of the image input: best_effort also hears drivers that offer no more',
    ),
)

# Parameters of a plant other than the linear one: only its own node knows and checks them.
PLANT_GROUP = 'plant.'

SCHEMA = Schema(
    (*_MODEL, *_SENSOR, *_CAMERA_EXTRAS, *_RUN, *_DISTURBANCE, *_CONTROL),
    open_groups=(PLANT_GROUP,),
)
