"""The compiled comparator against the NumPy one: the same events, bit for bit."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dvs_common.errors import ParameterError
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


def test_unknown_backend_is_refused():
    with pytest.raises(ParameterError, match='backend'):
        PixelArray(event_threshold=0.1, backend='cuda').update(0, [1.0])


def assert_same(one, other):
    for field in ('t', 'pixel', 'polarity', 'sign'):
        a, b = getattr(one, field), getattr(other, field)
        assert a.dtype == b.dtype
        assert np.array_equal(a, b), field


def test_machine_without_numba_falls_back_or_says_so(monkeypatch):
    from dvs_event_camera.pixels import compiled

    monkeypatch.setattr(compiled, 'kernels', lambda: None)
    PixelArray(event_threshold=0.1, backend='auto').update(0, np.ones(5000))
    with pytest.raises(ParameterError, match='numba'):
        PixelArray(event_threshold=0.1, backend='numba').update(0, [1.0])


def test_numba_that_may_not_compile_gives_way_to_numpy():
    code = (
        'import numpy as np\n'
        'from dvs_event_camera.pixels.pixel_array import PixelArray\n'
        'array = PixelArray(event_threshold=0.15)\n'
        'array.update(0, np.full(5000, 100.0))\n'
        'print(len(array.update(10**6, np.full(5000, 200.0))))\n'
    )
    found = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1'},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (found.stdout, found.stderr) == ('20000\n', '')
