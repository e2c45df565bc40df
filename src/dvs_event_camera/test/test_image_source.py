"""Every encoding against the pixels it was made from."""

import io

import numpy as np
import pytest

from dvs_common.wire.cdr import CdrWriter, MessageError
from dvs_common.wire.messages import pack_image
from dvs_event_camera.streams.image_source import (
    decode_picture,
    parse_compressed,
    parse_luminosity,
)

PIXELS = np.array([[1, 2, 3], [250, 0, 7]])


@pytest.mark.parametrize(
    ('encoding', 'dtype', 'darkest'),
    [('64FC1', '<f8', 0), ('32FC1', '<f4', 0), ('mono8', 'u1', 0.5), ('mono16', '<u2', 0.5)],
)
def test_single_channels(encoding, dtype, darkest):
    found = parse_luminosity(pack_image(42, PIXELS.astype(dtype), encoding))
    assert np.array_equal(found.pixels, PIXELS)
    assert found.pixels.dtype == np.dtype(dtype)
    assert (found.stamp_ns, found.darkest) == (42, darkest)


@pytest.mark.parametrize('encoding', ['rgb8', 'bgr8', 'rgba8', 'bgra8'])
def test_colours_become_luma(encoding):
    rng = np.random.default_rng(0)
    red, green, blue = rng.integers(0, 256, (3, 2, 3))
    planes = {'r': red, 'g': green, 'b': blue, 'a': np.full((2, 3), 255)}
    pixels = np.stack([planes[c] for c in encoding[:-1]], axis=2).astype(np.uint8)
    found = parse_luminosity(pack_image(0, pixels, encoding))
    assert np.allclose(found.pixels, 0.299 * red + 0.587 * green + 0.114 * blue, atol=1e-3)
    assert found.darkest == 0.5


def image_message(data, *, height=2, width=3, encoding='mono16', big_endian=False, step=6):
    writer = CdrWriter()
    writer.stamp(0)
    writer.text('camera')
    writer.u32(height)
    writer.u32(width)
    writer.text(encoding)
    writer.u8(big_endian)
    writer.u32(step)
    writer.octets(data)
    return writer.finish()


def test_big_endian_and_padded_rows():
    big = PIXELS.astype('>u2').tobytes()
    assert np.array_equal(parse_luminosity(image_message(big, big_endian=True)).pixels, PIXELS)
    rows = PIXELS.astype('<u2').view(np.uint8)
    padded = np.hstack([rows, np.full((2, 5), 99, np.uint8)]).tobytes()
    assert np.array_equal(parse_luminosity(image_message(padded, step=11)).pixels, PIXELS)


@pytest.mark.parametrize(
    'changes', [{'encoding': 'yuv422'}, {'step': 4}, {'width': 0, 'step': 0, 'height': 0}]
)
def test_what_is_no_luminosity_is_refused(changes):
    size = changes.get('step', 6) * changes.get('height', 2)
    with pytest.raises(MessageError):
        parse_luminosity(image_message(bytes(size), **changes))


def compressed(data):
    writer = CdrWriter()
    writer.stamp(7)
    writer.text('camera')
    writer.text('png')
    writer.octets(data)
    return writer.finish()


def test_compressed_image():
    image = pytest.importorskip('PIL.Image')
    for pixels in (PIXELS.astype(np.uint8), np.repeat(PIXELS[..., None], 3, 2).astype(np.uint8)):
        stream = io.BytesIO()
        image.fromarray(pixels).save(stream, format='png')
        found = parse_compressed(compressed(stream.getvalue()))
        assert np.allclose(found.pixels, PIXELS, atol=1e-3)
        assert (found.stamp_ns, found.darkest) == (7, 0.5)


def test_compressed_image_that_is_none():
    with pytest.raises(MessageError, match='compressed image of 4 bytes'):
        decode_picture(b'nope')


@pytest.mark.parametrize('shape', [(1, 65_537), (65_537, 1)])
def test_more_columns_than_an_event_can_name_are_refused(shape):
    with pytest.raises(MessageError, match='an event knows 65536 rows and columns'):
        parse_luminosity(pack_image(0, np.ones(shape, np.uint8), 'mono8'))
