"""Constants of geometric transforms: the cubic spline of :mod:`scipy.ndimage`."""

import math

# Pole and gain of the recursive filter that computes the coefficients of a cubic spline.
SPLINE_POLE = math.sqrt(3.0) - 2.0
SPLINE_GAIN = 6.0
SPLINE_REACH = 48  # pixels after which powers of the pole are negligible, below 1e-27
SPLINE_PAD = 12  # repeated pixels around an image in mode 'nearest', as in SciPy
OUTSIDE = -2.0  # coordinate of pixels that get `cval`; mapped coordinates are above -1
FARTHEST = 1e9  # larger coordinates, and NaN, are outside

# Places of bytes seen through a homography are rounded to 2^-23 of a pixel. To add START to a place
# rounds it to 2^-32; then the upper half of the number is START_HIGH and the pixel, and the lower
# half has the fraction of the place, whose first bits are those of the place rounded.
PLACE_BITS = 23
MIDDLE = 1.5 * 2**20
START = MIDDLE + 2.0 ** -(PLACE_BITS + 1)
START_HIGH = 0x41380000
WIDEST = 2.0**19  # places beyond are not rounded
