"""Raw bytes of a Kinect, for who has dumps of them."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _physinc

Bytes: TypeAlias = bytes | bytearray | memoryview | NDArray[np.uint8]
"""Contiguous bytes."""


def unpack_disparity(packed: Bytes, bits: Literal[11, 10] = 11) -> NDArray[np.uint16]:
    """Unpack a frame as a Kinect sends it: samples of 11 or 10 `bits`, most significant bit first, row by row.

    `packed` is 422,400 contiguous bytes, or 384,000 with 10 bits: the payloads of the frame's packets one after the other.

    Returns the disparity [480, 640], 2047 where there is no reading, in 10 bits too. Raises ValueError where `packed` isn't a frame.
    """
    samples = np.empty((480, 640), np.uint16)
    _physinc.unpack_disparity(np.frombuffer(packed, np.uint8), bits, samples)
    return samples
