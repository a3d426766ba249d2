"""Constants of shading that the API and both kernel sets share."""

from enum import IntEnum
from typing import NamedTuple

DIRECTIONAL, HARMONIC = 3, 9  # coefficients of a light: a vector, or harmonics up to degree 2
SHADOW_BIAS = 1e-3  # pixels by which a surface must rise above a ray to block it
NOTHING = 2**63 - 1  # key of a pixel that no triangle covers
DEPTH_STEPS = 2.0**12  # steps of depth per pixel, in the upper half of a key


class Photometric(IntEnum):
    """How the images of a pixel are weighed."""

    LEAST_SQUARES = 0
    TRIMMED = 1
    L1 = 2
    SPARSE_BAYES = 3
    CONSENSUS = 4


class Weighing(NamedTuple):
    """How the images of a pixel are weighed, and in how many sweeps."""

    method: int
    sweeps: int


LEFT_OUT = 65535  # rank of a value that is ignored
MOST_LIGHTS = 1024  # largest number of images
RIDGE = 1e-9  # share of the trace of the normal equations that is added to their diagonal
FLOOR = 1e-6  # least weight of an image within its window
SPARSE_NOISE = 1e-6  # noise variance of sparse Bayes, for values of at most 1
CHUNKS = 1024  # number of partial sums over all pixels
GUIDED, GUIDED_FROM = 0.5, 0.1  # weight of the guide in a sweep, and the least n_z for it
