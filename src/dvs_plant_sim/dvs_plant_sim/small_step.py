"""One step of a small linear plant, from the bytes of a command to those of the next image.

Between two messages a node's caches go cold, and a NumPy call costs more than arithmetic with a
few numbers. So what does not depend on the command is done while the plant waits for it, and the
rest with Python's floats, in the order in which NumPy does it: the same bits.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from dvs_common.arrays import FEW_FLOATS, FloatArray
from dvs_common.scenario.model import PixelScene, PlantModel
from dvs_common.wire.messages import Vector, pack_command, pack_image
from dvs_plant_sim.plant import Plant

LARGEST_INPUT = 1e100
_DOUBLE = 8


class SmallStep:
    """Advances a plant by its sampling period; `fits` is true for plants for which it can.

    Parameters
    ----------
    plant
        Plant that is advanced.
    model
        Its c, and its number of inputs.
    scene
        What the pixels see.
    input_names
        Names of the inputs.
    output_disturbance
        Added to every luminosity.
    needs_light
        Whether the pixels see nothing where the luminosity is not positive.
    """

    def __init__(
        self,
        plant: Plant,
        model: PlantModel,
        scene: PixelScene,
        *,
        input_names: tuple[str, ...],
        output_disturbance: float,
        needs_light: bool,
    ) -> None:
        self._plant = plant
        self._transition, gain = plant.period_step
        self._gain: list[float] = gain[:, 0].tolist()
        self._gradient: FloatArray = model.gradient
        self._offsets: list[float] = scene.brightness_offsets.tolist()
        self._disturbance = output_disturbance
        self._dark = 0.0 if needs_light else -math.inf
        self._names = input_names
        self._no_pixels = np.zeros((scene.height, scene.width))
        self._pixels = struct.Struct(f'<{scene.pixel_count}d')
        self._awaited: bytes | None = None

    @staticmethod
    def fits(model: PlantModel, scene: PixelScene) -> bool:
        """Whether a plant has one input and few pixels, of one group, that see a straight line.

        Parameters
        ----------
        model
            A, B, c.
        scene
            What the pixels see.
        """
        few = scene.pixel_count <= FEW_FLOATS
        plain = scene.groups is None and scene.profile is None
        return few and plain and model.input_count == 1

    def prepare(self, stamp_ns: int) -> None:
        """Do before a command comes what does not depend on it.

        Parameters
        ----------
        stamp_ns
            Stamp of the sample that it answers, ns.
        """
        command = Vector(stamp_ns=stamp_ns, names=self._names, values=np.zeros(1))
        self._awaited = pack_command(command)[:-_DOUBLE]
        image = pack_image(stamp_ns + self._plant.period_ns, self._no_pixels, '64FC1')
        self._head = image[: -self._pixels.size]
        self._drift: list[float] = (self._transition @ self._plant.state).tolist()

    def image_after(self, command: bytes) -> bytes | None:
        """Advance the plant; return the serialized image of what the pixels see then.

        None, and nothing has changed, where the command is not the one that was prepared for, or
        it leads to what needs a closer look: no numbers, or a luminosity that is
        not positive. A preparation serves once.

        Parameters
        ----------
        command
            CDR bytes.
        """
        awaited, self._awaited = self._awaited, None
        if awaited is None or not command.startswith(awaited):
            return None
        if len(command) != len(awaited) + _DOUBLE:
            return None
        (u,) = struct.unpack_from('<d', command, len(awaited))
        # A product with zero may have another sign by BLAS; NaN is not less than anything.
        if not (u and abs(u) < LARGEST_INPUT):
            return None
        state = [drift + gain * u for drift, gain in zip(self._drift, self._gain, strict=True)]
        if not math.isfinite(sum(state)):
            return None
        array = np.array(state)
        seen, disturbance = float(self._gradient @ array), self._disturbance
        luminosity = [seen + offset + disturbance for offset in self._offsets]
        if not math.isfinite(sum(luminosity)) or min(luminosity) <= self._dark:
            return None
        self._plant.state = array
        return self._head + self._pixels.pack(*luminosity)
