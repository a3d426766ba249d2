"""Constants of geometric transforms: the cubic spline of :mod:`scipy.ndimage`."""

import math

# Pole and gain of the recursive filter that computes the coefficients of a cubic spline.
SPLINE_POLE = math.sqrt(3.0) - 2.0
SPLINE_GAIN = 6.0
SPLINE_REACH = 48  # pixels after which powers of the pole are negligible, below 1e-27
SPLINE_PAD = 12  # repeated pixels around an image in mode 'nearest', as in SciPy
OUTSIDE = -2.0  # coordinate of pixels that get `cval`; mapped coordinates are above -1
FARTHEST = 1e9  # larger coordinates, and NaN, are outside
