"""Every encoding against the pixels it was made from."""

import io
import math
import sys

import numpy as np
import pytest

from dvs_common.wire.cdr import CdrWriter, MessageError
from dvs_common.wire.messages import pack_image
from dvs_common.wire.stamped import Memo
from dvs_event_camera.streams import image_source
from dvs_event_camera.streams.image_source import (
    decode_picture,
    few_pixels,
    parse_compressed,
    parse_luminosity,
)

PIXELS = np.array([[1, 2, 3], [250, 0, 7]])


@pytest.mark.parametrize(
    ('encoding', 'dtype', 'darkest'),
    [('64FC1', '<f8', 0), ('32FC1', '<f4', 0), ('mono8', 'u1', 0.5), ('mono16', '<u2', 0.5)],
)
def test_an_image_of_one_channel_is_its_luminosity(encoding, dtype, darkest):
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
    ('encoding', 'first'), [('yuv422', 1), ('uyvy', 1), ('yuv422_yuy2', 0), ('yuyv', 0)]
)
def test_luma_of_interleaved_yuv(encoding, first):
    pixels = np.full((2, 4, 2), 128, np.uint8)
    pixels[..., first] = np.arange(8).reshape(2, 4)
    found = parse_luminosity(pack_image(0, pixels, encoding))
    assert np.array_equal(found.pixels, np.arange(8).reshape(2, 4))
    assert found.pixels.flags.c_contiguous


@pytest.mark.parametrize('encoding', ['nv12', 'nv21'])
@pytest.mark.parametrize('height', [4, 6])
def test_luma_of_planar_yuv_whether_height_counts_the_chroma_or_not(encoding, height):
    luma = np.arange(32, dtype=np.uint8).reshape(4, 8)
    data = np.vstack([luma, np.full((2, 8), 128, np.uint8)]).tobytes()
    message = image_message(data, height=height, width=8, encoding=encoding, step=8)
    assert np.array_equal(parse_luminosity(message).pixels, luma)


def test_planar_yuv_without_its_chroma_is_refused():
    with pytest.raises(MessageError, match='chroma'):
        parse_luminosity(pack_image(0, np.zeros((4, 8), np.uint8), 'nv12'))


@pytest.mark.parametrize('encoding', ['rgb16', 'bgr16', '16UC3', 'rgba16'])
@pytest.mark.parametrize('big_endian', [False, True])
def test_colours_of_16_bits(encoding, big_endian):
    order = {'16UC3': 'bgr'}.get(encoding, encoding[:-2])
    planes = {'r': 1000, 'g': 20000, 'b': 60000, 'a': 65535}
    pixels = np.array([planes[c] for c in order] * 6, '>u2' if big_endian else '<u2')
    message = image_message(
        pixels.tobytes(), encoding=encoding, big_endian=big_endian, step=6 * len(order)
    )
    expected = 0.299 * 1000 + 0.587 * 20000 + 0.114 * 60000
    assert np.allclose(parse_luminosity(message).pixels, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ('encoding', 'dtype'),
    [('bayer_rggb8', 'u1'), ('bayer_gbrg16', '<u2'), ('16SC1', '<i2'), ('32SC1', '<i4')],
)
def test_mosaics_and_signed_integers_are_taken_as_they_are(encoding, dtype):
    found = parse_luminosity(pack_image(0, PIXELS.astype(dtype), encoding))
    assert np.array_equal(found.pixels, PIXELS)
    assert found.darkest == 0.5


def test_unopened_cv_types_are_blue_green_red():
    rng = np.random.default_rng(0)
    for encoding, same in (('8UC3', 'bgr8'), ('8UC4', 'bgra8')):
        pixels = rng.integers(0, 256, (2, 3, int(encoding[-1]))).astype(np.uint8)
        found = [parse_luminosity(pack_image(0, pixels, name)).pixels for name in (encoding, same)]
        assert np.array_equal(*found)


@pytest.mark.parametrize('name', ['yuv420', '32FC3', 'jpeg'])
def test_encoding_that_holds_no_luminosity_is_refused_by_its_name(name):
    with pytest.raises(MessageError, match=f"encoding '{name}'"):
        parse_luminosity(image_message(bytes(12), encoding=name))


@pytest.mark.parametrize('decoder', ['cv2', 'PIL.Image'])
def test_pictures_of_16_bits_and_floats_keep_their_ratios(decoder, monkeypatch):
    pytest.importorskip(decoder)
    image = pytest.importorskip('PIL.Image')
    if decoder != 'cv2':
        monkeypatch.setitem(sys.modules, 'cv2', None)
    deep = np.array([[100, 1000, 10000, 60000]], np.uint16)
    bright = np.array([[0.01, 0.1, 0.5, 2.0]], np.float32)
    ten_bits = np.array([[1, 10, 100, 1000]], '>u2')
    files = [
        (b'P5\n4 1\n65535\n' + deep.astype('>u2').tobytes(), deep),
        (b'P5\n4 1\n1023\n' + ten_bits.tobytes(), ten_bits),
    ]
    for pixels, ending in ((deep, 'png'), (bright, 'tiff')):
        stream = io.BytesIO()
        image.fromarray(pixels).save(stream, format=ending)
        files.append((stream.getvalue(), pixels))
    for data, expected in files:
        found = decode_picture(data).pixels[0].astype(float)
        assert np.allclose(found / found[3], expected[0] / expected[0, 3], rtol=1e-4, atol=2e-5)


@pytest.mark.parametrize(
    'changes', [{'encoding': 'yuv420'}, {'step': 4}, {'width': 0, 'step': 0, 'height': 0}]
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


def test_a_compressed_image_holds_the_luminosity_of_its_pixels():
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
    with pytest.raises(MessageError, match='coordinates of an event end at 65536'):
        parse_luminosity(pack_image(0, np.ones(shape, np.uint8), 'mono8'))


@pytest.mark.parametrize(
    ('shape', 'dtype', 'encoding', 'is_read'),
    [
        ((3, 3), '<f8', '64FC1', True),
        ((4, 8), '<f8', '64FC1', True),
        ((1, 33), '<f8', '64FC1', False),
        ((3, 3), '<f4', '32FC1', False),
        ((3, 3), 'u1', 'mono8', False),
    ],
)
def test_a_few_doubles_of_a_known_stream_are_read_without_an_array(
    shape, dtype, encoding, is_read, monkeypatch
):
    monkeypatch.setattr(image_source, '_known', Memo())
    pixels = np.arange(math.prod(shape)).reshape(shape).astype(dtype)
    message = pack_image(7, pixels, encoding)
    assert few_pixels(message) is None
    parse_luminosity(message)
    few = few_pixels(message)

    assert (few is not None) == is_read
    if few is not None:
        assert few.shape == shape
        assert few.luminosity(message) == tuple(pixels.ravel().tolist())
        assert few_pixels(message[:-1]) is None
