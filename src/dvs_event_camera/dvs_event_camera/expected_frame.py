"""The next frame of a few pixels, known by its bytes before it comes, and what silence answers."""

from __future__ import annotations

from dataclasses import dataclass

from dvs_common.wire.events import NO_EVENTS, EventPacket, pack_events
from dvs_common.wire.stamp_gate import StampGate
from dvs_common.wire.stamped import BODY, stamp_of, stamped
from dvs_event_camera.event_camera import EventCamera
from dvs_event_camera.streams.image_source import FewPixels, few_pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedFrame:
    """A next image that differs from the last one in its stamp and its pixels alone.

    Parameters
    ----------
    stamp_ns
        Its stamp, ns.
    head
        All bytes before its pixels.
    size
        Bytes of the whole message.
    few
        How its pixels are read.
    packet
        What follows from it if it holds no event.
    answer
        That packet as CDR bytes.
    """

    stamp_ns: int
    head: bytes
    size: int
    few: FewPixels
    packet: EventPacket
    answer: bytes

    @classmethod
    def after(cls, message: bytes, few: FewPixels, stamp_ns: int) -> ExpectedFrame:
        """Frame that follows an image of the same stream.

        Parameters
        ----------
        message
            CDR bytes of the image.
        few
            How its pixels are read.
        stamp_ns
            Stamp of the next one, ns.
        """
        packet = EventPacket(stamp_ns=stamp_ns, events=NO_EVENTS)
        return cls(
            stamp_ns=stamp_ns,
            head=stamped(stamp_ns, message[BODY : few.start]),
            size=len(message),
            few=few,
            packet=packet,
            answer=pack_events(packet),
        )


class ExpectedFrames:
    """Takes frames of a regular stream of few pixels in which nothing happens.

    Parameters
    ----------
    gate
        Judge of the stamps of the stream.
    """

    def __init__(self, gate: StampGate) -> None:
        self._gate = gate
        self._expected: ExpectedFrame | None = None
        self._stamp_ns = 0

    def forget(self) -> None:
        """Expect nothing any more."""
        self._expected = None

    def take(self, message: bytes, camera: EventCamera) -> ExpectedFrame | None:
        """Expose the camera to the expected frame if it is silent; None, and nothing, otherwise.

        Parameters
        ----------
        message
            CDR bytes.
        camera
            The camera.
        """
        expected, self._expected = self._expected, None
        if expected is None or not message.startswith(expected.head):
            return None
        if len(message) != expected.size:
            return None
        few = expected.few
        if not camera.pass_silence(expected.stamp_ns, few.luminosity(message), few.shape):
            return None
        self._gate.take(expected.stamp_ns)
        return expected

    def expect_after(self, message: bytes, *, before_ns: float) -> None:
        """Expect a frame as long after an image as that one was after the last.

        Parameters
        ----------
        message
            CDR bytes of an image that was taken.
        before_ns
            Stamp from which on more than a packet is due, ns.
        """
        stamp_ns = stamp_of(message)
        next_ns = 2 * stamp_ns - self._stamp_ns
        self._stamp_ns = stamp_ns
        few = few_pixels(message)
        if few is not None and next_ns < before_ns and self._gate.follows(next_ns):
            self._expected = ExpectedFrame.after(message, few, next_ns)
