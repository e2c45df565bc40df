"""Recordings as sensors write them, and the converter that tests call."""

from dvs_event_camera.tools import convert_events

# Time [us], source and direction of two triggers.
EDGES = [(12_345, 0, 1), (20_001, 1, 0)]


def raw_file(path, head, words):
    path.write_bytes(head.encode() + words.tobytes())
    return path


def convert(source, target, *arguments):
    assert convert_events.main([str(source), str(target), *arguments]) == 0
    return target
