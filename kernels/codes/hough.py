"""Constants of Hough transforms: directions, and numbers in fixed point."""

# Directions are taken to the nearest of these over the full turn (0.022 degrees): floor of the
# angle times the factor, plus a half, in float32.
DIRECTIONS = 16384
DIRECTION_FACTOR = 2607.594482421875  # float32 of DIRECTIONS / (2 pi)

# The generalised Hough transform in integers. Vectors of a table are in 1/256 pixel; cosines and
# sines in 2^-20; turned vectors in 1/16 pixel; scales in 1/2048. So a turn fits into 64 bits, a
# scaled vector into 32 as long as it is shorter than 2^16 pixels.
VECTOR_ONE = 1 << 8
TURN_ONE = 1 << 20
TURNED_ONE = 1 << 4
SCALE_ONE = 1 << 11
TILE = 8  # cells along the side of what one peak is reported of

# Circles in integers. Lines are walked in 2^-15 of a cell; sums over the points of a circle have
# its normals in 2^-14, and distances from it in 2^-10 of a pixel.
LINE_ONE = 1 << 15
NORMAL_ONE = 1 << 14
FINE_ONE = 1 << 10
ARCS = 64  # parts of a circle that are counted apart: of each octant eight, by the slope
MAX_BINS = 8192  # of the minor axis of an ellipse, in the shared memory of a block
