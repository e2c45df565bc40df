"""The compiled comparator against the NumPy one: the same events, bit for bit."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
from dvs_event_camera.pixels.imperfections import Imperfections
from dvs_event_camera.pixels.photoreceptor import LinLogPhotoreceptor, LogPhotoreceptor
from dvs_event_camera.pixels.pixel_array import PixelArray

pytest.importorskip('numba')


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 3, 8, 61]),
    st.floats(0.01, 0.7),
    st.sampled_from([1, 977, 1_000_000, 3_000_000_000, 2**46]),
    st.sampled_from([LogPhotoreceptor(), LogPhotoreceptor(log_floor=0.5), LinLogPhotoreceptor()]),
)
@settings(max_examples=150, deadline=None)
def test_same_events_bit_for_bit(seed, size, h, period_ns, receptor):
    rng = np.random.default_rng(seed)
    arrays = [
        PixelArray(
            event_threshold=h,
            photoreceptor=receptor,
            reference_uncertainty=1e-4,
            initial_reference='random',
            backend=backend,
        )
        for backend in ('numba', 'numpy')
    ]
    level = rng.normal(3, 1, size)
    for k in range(6):
        y = np.exp(level)
        if k:
            y[rng.random(size) < 0.05] = rng.choice([np.nan, np.inf, -1.0, 0.0])
        one, other = (array.update(k * period_ns, y) for array in arrays)
        assert_same(one, other)
        level += rng.choice([1e-9, 0.1, 2.0]) * rng.normal(size=size)
    assert np.array_equal(arrays[0].counts, arrays[1].counts)
    assert arrays[0].invalid_samples == arrays[1].invalid_samples


def test_frame_of_many_tiles_and_many_events():
    rng = np.random.default_rng(1)
    arrays = [PixelArray(event_threshold=0.1, backend=b) for b in ('numba', 'numpy')]
    for k in range(4):
        y = rng.integers(1, 255, 3 * 16384 + 5).astype(np.uint8)
        one, other = (array.update(k * 1000, y) for array in arrays)
        assert_same(one, other)
    assert len(one) > y.size


def test_logarithm_does_not_depend_on_the_place_in_the_tile():
    values = np.random.default_rng(0).lognormal(size=1001)
    whole = np.log(values)
    assert all(np.log(values[i : i + 1])[0] == whole[i] for i in range(values.size))
    assert np.array_equal(np.log(values[3:]), whole[3:])


def test_integer_frames_give_the_events_of_the_same_floats():
    arrays = [PixelArray(event_threshold=0.1) for _ in range(4)]
    rng = np.random.default_rng(0)
    for k in range(5):
        y = rng.integers(1, 255, 100)
        found = [
            array.update(k * 1000, y.astype(dtype))
            for array, dtype in zip(arrays, ('u1', 'u2', 'f4', 'f8'), strict=True)
        ]
        for events in found[1:]:
            assert_same(found[0], events)


MODES = [
    {},
    {'interpolation': 'hermite'},
    {'imperfections': Imperfections(threshold_mismatch=0.2)},
    {'imperfections': Imperfections(event_threshold_off=0.25)},
    {'imperfections': Imperfections(refractory_period=3e-4)},
    {'imperfections': Imperfections(shot_noise_rate=300.0, shot_noise_luminosity=40.0)},
    {'imperfections': Imperfections(shot_noise_rate=300.0, reset='level')},
    {'imperfections': Imperfections(refractory_period=3e-4, reset='level')},
    {'imperfections': Imperfections(leak_rate=30.0), 'label_noise': True},
    {'imperfections': Imperfections(cutoff_frequency=300.0, cutoff_luminosity=20.0)},
    {'imperfections': Imperfections(jitter=1e-4)},
    {
        'imperfections': Imperfections(
            threshold_mismatch=0.1,
            refractory_period=1e-4,
            leak_rate=20.0,
            shot_noise_rate=200.0,
            cutoff_frequency=500.0,
            hot_pixel_fraction=0.1,
            dead_pixel_fraction=0.1,
            latency=2e-4,
            jitter=1e-4,
        ),
        'label_noise': True,
    },
]


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('period_ns', [1, 1_000_000, 2**46])
def test_every_mode_is_the_same_compiled_and_with_threads(mode, period_ns):
    noisy = 'imperfections' in mode and period_ns > 10**9
    size = 7 if noisy else 300
    frames = 12
    if noisy and mode['imperfections'].shot_noise_rate + mode['imperfections'].leak_rate:
        # In 8 s a noisy pixel makes thousands of events.
        period_ns, frames = 2**33, 5
    rng = np.random.default_rng(5)
    arrays = [
        PixelArray(event_threshold=0.1, backend=backend, threads=threads, seed=9, **mode)
        for backend, threads in (('numpy', 1), ('numba', 1), ('numba', 3))
    ]
    level = rng.normal(3, 1, size)
    for k in range(frames):
        y = np.exp(level)
        y[rng.random(size) < 0.05] = rng.choice([np.nan, np.inf, -1.0, 0.0])
        # Some frames are kept as they are, the others are copied.
        y.setflags(write=k % 3 > 0)
        reference, *others = (array.update(k * period_ns, y) for array in arrays)
        for events in others:
            assert_same(reference, events)
        level += rng.choice([1e-9, 0.05, 0.5, 2.0]) * rng.normal(size=size)
    for array in arrays[1:]:
        assert np.array_equal(arrays[0].counts, array.counts)
        assert arrays[0].invalid_samples == array.invalid_samples
        assert arrays[0].waiting_pixels == array.waiting_pixels


@pytest.mark.parametrize('mode', [MODES[0], MODES[1], MODES[-1]])
@pytest.mark.parametrize('dtype', ['u1', '>u2', 'f4', 'f8', 'i4'])
def test_number_types_of_frames_change_nothing_but_the_speed(mode, dtype):
    rng = np.random.default_rng(2)
    receptor = LogPhotoreceptor(log_floor=0.5)
    arrays = [
        PixelArray(event_threshold=0.1, photoreceptor=receptor, backend=backend, **mode)
        for backend in ('numpy', 'numba')
    ]
    light = rng.integers(0, 256, 400)
    for k in range(8):
        light = np.clip(light + rng.integers(-3, 4, 400) * rng.choice([0, 1, 30]), 0, 255)
        # A stream may change its type on the way.
        frame = light.astype('f8' if k == 5 else dtype)
        assert_same(*(array.update(k * 1_000_000, frame) for array in arrays))
    assert np.array_equal(arrays[0].counts, arrays[1].counts)


def test_a_frame_that_its_owner_overwrites_was_copied():
    rng = np.random.default_rng(6)
    arrays = [PixelArray(event_threshold=0.1, backend=b) for b in ('numpy', 'numba')]
    buffer = np.empty(500)
    for k in range(5):
        buffer[:] = rng.uniform(1.0, 9.0, 500)
        window = buffer.view()
        window.setflags(write=False)
        assert_same(*(array.update(k * 1000, window) for array in arrays))


def test_only_what_is_read_only_down_to_its_owner_is_frozen():
    from dvs_event_camera.pixels.compiled_pixels import is_frozen

    octets = bytes(16)
    own = np.ones(2)
    assert is_frozen(np.frombuffer(octets))
    assert is_frozen(np.frombuffer(memoryview(octets)).reshape(1, 2))
    assert not is_frozen(np.frombuffer(bytearray(octets)))
    assert not is_frozen(np.broadcast_to(own, (3, 2)))
    own.setflags(write=False)
    assert is_frozen(own[:1])


@given(
    st.floats(-25.0, 25.0), st.sampled_from([1e-5, 0.15, 2.0, 14.0, 40.0]), st.floats(-1.2, 1.2)
)
@settings(max_examples=200, deadline=None)
def test_what_a_band_takes_for_silent_lies_between_the_thresholds(reference, width, share):
    from dvs_event_camera.pixels import pixel_kernels
    from dvs_event_camera.pixels.bands import bands_for

    log = LogPhotoreceptor()
    bands = bands_for(1, np.dtype('f8'), width, log, pixel_kernels, levels=False)
    edges = np.array([[reference - width], [reference + width]])
    light = np.exp(np.array([reference + share * width]))
    light.setflags(write=False)
    mask, found = np.zeros(pixel_kernels.TILE + 8, np.uint8), np.zeros(1, np.int32)

    def news():
        return bands.find(light, slice(0, 1), light[:0].copy(), mask, found, 0)

    assert news() == 1
    bands.settle(found, edges)
    if abs(share) >= 1:
        assert news() == 1
    elif abs(share) < 0.8 and width > 1e-4:
        assert news() == 0


def test_a_new_threshold_is_the_same_compiled():
    rng = np.random.default_rng(3)
    arrays = [PixelArray(event_threshold=0.2, backend=b) for b in ('numpy', 'numba')]
    level = rng.normal(3, 1, 100)
    for k in range(20):
        y = np.exp(level)
        y[k] = np.nan
        assert_same(*(array.update(k * 1000, y) for array in arrays))
        if k % 5 == 4:
            for array in arrays:
                array.change_event_threshold(0.01 * k)
        level += 0.2 * rng.normal(size=100)


def test_own_photoreceptor_without_an_inverse_is_the_same_compiled():
    class Root:
        dead_band = None

        def levels(self, luminosity, out=None):
            with np.errstate(invalid='ignore'):
                return np.sqrt(luminosity, out=out)

        def floored(self, luminosity):
            return luminosity

    rng = np.random.default_rng(4)
    arrays = [
        PixelArray(event_threshold=0.2, photoreceptor=Root(), backend=b)
        for b in ('numpy', 'numba')
    ]
    for k in range(5):
        y = rng.uniform(0.0, 9.0, 100)
        assert_same(*(array.update(k * 1000, y) for array in arrays))


@given(st.lists(st.integers(0, 2**40), max_size=700), st.integers(0, 12))
@settings(max_examples=60, deadline=None)
def test_digits_sort_as_comparisons_do(keys, first_bit):
    from dvs_event_camera.pixels.pixel_kernels import radix_sort

    # Below the first bit the keys are in order, as those of one pixel after the other are.
    low = (1 << first_bit) - 1
    array = np.array(sorted(keys, key=lambda key: key & low), np.int64)
    radix_sort(array, np.empty_like(array), first_bit, 41)
    assert array.tolist() == sorted(keys)


@pytest.mark.processes
@pytest.mark.parametrize('damaged', ['*.nbi', '*.nbc', ''])
def test_cache_of_compiled_kernels_that_is_broken_costs_one_line_and_no_result(tmp_path, damaged):
    (tmp_path / 'small.py').write_text(
        'from dvs_event_camera.pixels.kernel_cache import kernel\n\n'
        '@kernel\ndef twice(x):\n    return 2 * x\n'
    )
    place = tmp_path / 'cache'

    def run():
        return subprocess.run(
            [sys.executable, '-c', 'import small; print(small.twice(21))'],
            cwd=tmp_path,
            env={**os.environ, 'NUMBA_CACHE_DIR': str(place)},
            capture_output=True,
            text=True,
            check=False,
        )

    first = run()
    assert (first.stdout, first.stderr) == ('42\n', '')
    for file in place.rglob(damaged or '*.none'):
        file.write_bytes(b'nonsense')
    second = run()
    assert second.stdout == '42\n', second.stderr
    assert second.stderr.count('cache of compiled kernels cannot be read') == bool(damaged)


@pytest.mark.parametrize('threads', [0, 65])
def test_number_of_threads_is_checked(threads):
    with pytest.raises(ParameterError, match='threads'):
        PixelArray(event_threshold=0.1, threads=threads)


def test_unknown_backend_is_refused():
    with pytest.raises(ParameterError, match='backend'):
        PixelArray(event_threshold=0.1, backend='cuda').update(0, [1.0])


def assert_same(one, other):
    for field in ('t', 'pixel', 'polarity', 'sign', 'noise'):
        a, b = getattr(one, field), getattr(other, field)
        if field == 'noise' and (a is None or not a.size):
            assert b is None or b.size == len(one)
            continue
        assert a.dtype == b.dtype
        assert np.array_equal(a, b), field


def test_machine_without_numba_falls_back_or_names_the_package(monkeypatch):
    from dvs_event_camera.pixels import compiled

    monkeypatch.setattr(compiled, 'kernels', lambda: None)
    PixelArray(event_threshold=0.1, backend='auto').update(0, np.ones(5000))
    with pytest.raises(ParameterError, match='numba'):
        PixelArray(event_threshold=0.1, backend='numba').update(0, [1.0])


@pytest.mark.processes
@pytest.mark.parametrize(
    'variables',
    [
        {'NUMBA_DISABLE_JIT': '1'},
        {'NUMBA_NUM_THREADS': '0', 'OMP_NUM_THREADS': 'none'},
        {'NUMBA_CACHE_DIR': '/proc/no/such/folder'},
    ],
    ids=lambda variables: next(iter(variables)),
)
def test_whatever_the_settings_of_numba_the_events_are_the_same(variables):
    code = (
        'import numpy as np\n'
        'from dvs_event_camera.pixels.pixel_array import PixelArray\n'
        'array = PixelArray(event_threshold=0.15)\n'
        'array.update(0, np.full(5000, 100.0))\n'
        'print(len(array.update(10**6, np.full(5000, 200.0))))\n'
    )
    found = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout == '20000\n'
    assert len(found.stderr.splitlines()) <= 1, found.stderr
