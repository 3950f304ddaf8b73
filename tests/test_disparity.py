"""Raw bytes of a Kinect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import physinc


def packed(samples: NDArray[np.uint16], bits: int) -> NDArray[np.uint8]:
    """Bit by bit, as the definition says."""
    return np.packbits((samples.reshape(-1, 1) >> np.arange(bits - 1, -1, -1) & 1).astype(np.uint8))


def test_samples_come_back() -> None:
    samples = np.random.default_rng(0).integers(0, 2048, (480, 640), np.uint16)
    array = packed(samples, 11)
    for frame in (array, array.tobytes(), bytearray(array), memoryview(array.tobytes()), array.reshape(480, 880)):
        unpacked = physinc.unpack_disparity(frame)
        assert unpacked.dtype == np.uint16
        np.testing.assert_array_equal(unpacked, samples)
    ten = samples // 2
    np.testing.assert_array_equal(physinc.unpack_disparity(packed(ten, 10), bits=10), np.where(ten == 1023, 2047, ten))


@pytest.mark.parametrize(
    ("frame", "bits", "message"),
    [
        (b"", 11, "packed has 0 bytes: expected 422400"),
        (bytes(422_401), 11, "packed has 422401 bytes: expected 422400"),
        (bytes(422_400), 10, "packed has 422400 bytes: expected 384000, 640 × 480 samples of 10 bits"),
        (bytes(422_400), 12, "bits = 12: expected 11 or 10"),
        (np.zeros(2 * 422_400, np.uint8)[::2], 11, "contiguous"),
    ],
)
def test_what_is_no_frame_is_refused(frame: Any, bits: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        physinc.unpack_disparity(frame, bits)
