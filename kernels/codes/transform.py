"""Constants of geometric transforms: the cubic spline of :mod:`scipy.ndimage`."""

import math

# The recursive filter that gives a cubic spline its coefficients has this pole, and this gain.
SPLINE_POLE = math.sqrt(3.0) - 2.0
SPLINE_GAIN = 6.0
SPLINE_REACH = 48  # pixels after which a power of the pole, below 1e-27, no longer counts
SPLINE_PAD = 12  # pixels that are repeated round an image in mode 'nearest', as SciPy has it
OUTSIDE = -2.0  # coordinate of what gets `cval`; every other mapped coordinate is above -1
FARTHEST = 1e9  # coordinates from here on, and those that are not numbers, are outside
