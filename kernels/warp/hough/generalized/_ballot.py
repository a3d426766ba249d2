"""The inputs of the votes, as a structure for the kernels of both devices."""

from typing import Any

import warp as wp

from cvkern.kernels.codes.hough import SCALE_ONE, TURN_ONE, TURNED_ONE, VECTOR_ONE
from cvkern.kernels.warp._structs import struct_of

# Bits by which a rotated vector is shifted to its unit, and a scaled vector to whole pixels.
TURNED_BITS = (TURN_ONE * VECTOR_ONE // TURNED_ONE).bit_length() - 1
SCALED_BITS = (TURNED_ONE * SCALE_ONE).bit_length() - 1


@wp.struct
class Ballot:
    """Voters, entries, slices and cells; see `codes.hough`."""

    points: wp.array2d[int]  # (2, P + 16): rows, columns
    starts: wp.array[int]  # (2 DIRECTIONS + 1,)
    vectors: wp.array2d[int]  # (N, 2)
    directions: wp.array[int]  # (N,)
    turns: wp.array2d[int]  # (R, 3): code, cosine, sine
    scales: wp.array[int]  # (S,)
    tolerance: int
    height: int
    width: int
    shift: int


def ballot_of(voters: Any, entries: Any, slices: Any, tolerance: int, cells: Any) -> Any:
    """Return the structure of a primitive's inputs."""
    return struct_of(Ballot, (*voters, *entries, *slices, tolerance, *cells))
