"""Non-maximum suppression of one pixel; _masks_cpu.h has the same rules for a row."""

import warp as wp

from cvkern.kernels.codes.edges import SECTOR_HIGH, SECTOR_LOW, SECTOR_ONE, Norm, Thinning

ONE = wp.constant(SECTOR_ONE)
LOW = wp.constant(SECTOR_LOW)
HIGH = wp.constant(SECTOR_HIGH)


@wp.func
def measure(dy: float, dx: float, norm: int) -> float:
    """Return the gradient length that thresholds are compared with; its square for L2."""
    return wp.where(norm == Norm.L1, wp.abs(dx) + wp.abs(dy), dx * dx + dy * dy)


@wp.func
def compared(m: float, norm: int, rule: int) -> float:
    """Return the value that neighbours are compared by; interpolation needs the length itself."""
    return wp.where(norm == Norm.L2 and rule != Thinning.SECTORS, wp.sqrt(m), m)


@wp.func
def is_maximum_in_sector(
    dy: float,
    dx: float,
    nw: float,
    n: float,
    ne: float,
    w: float,
    c: float,
    e: float,
    sw: float,
    s: float,
    se: float,
) -> bool:
    """Compare `c` with the two of its eight neighbours nearest to the gradient, as in cv2.Canny."""
    ax = wp.abs(dx)
    ay = wp.abs(dy) * ONE
    across = ay < ax * LOW
    down = ay > ax * HIGH
    opposite = (dx < 0.0) != (dy < 0.0)
    back = wp.where(across, w, wp.where(down, n, wp.where(opposite, ne, nw)))
    ahead = wp.where(across, e, wp.where(down, s, wp.where(opposite, sw, se)))
    # On an axis a tie goes to the first pixel; on a diagonal neither pixel is kept.
    return c > back and wp.where(across or down, c >= ahead, c > ahead)


@wp.func
def is_maximum_between(
    dy: float,
    dx: float,
    nw: float,
    n: float,
    ne: float,
    w: float,
    c: float,
    e: float,
    sw: float,
    s: float,
    se: float,
    framed: bool,
) -> bool:
    """Compare `c` with values interpolated where the gradient leaves the 3 x 3 neighbourhood.

    Both sides are multiplied by the larger derivative, which avoids a division.
    """
    ax = wp.abs(dx)
    ay = wp.abs(dy)
    down = ay > ax
    large = wp.max(ax, ay)
    small = wp.min(ax, ay)
    opposite = (dx < 0.0) != (dy < 0.0)
    corner_back = wp.where(opposite, wp.where(down, ne, sw), nw)
    corner_ahead = wp.where(opposite, wp.where(down, sw, ne), se)
    back = wp.where(down, n, w) * (large - small) + corner_back * small
    ahead = wp.where(down, s, e) * (large - small) + corner_ahead * small
    top = c * large
    return (top > back or (framed and top == back)) and top >= ahead
