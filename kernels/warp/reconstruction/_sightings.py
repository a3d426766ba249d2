"""Which view sees which point, in Warp."""

import warp as wp


@wp.struct
class Seen:
    """Which view sees which point; see `codes.reconstruction.Sightings`."""

    ends: wp.array2d[int]
    spans: wp.array2d[int]
    order: wp.array[int]
    ranges: wp.array2d[int]
