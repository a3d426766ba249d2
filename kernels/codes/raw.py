"""Codes of raw pictures that the API and the kernel sets share."""

from enum import IntEnum


class Linear(IntEnum):
    """Demosaicing by fixed filters."""

    BILINEAR = 0
    MALVAR = 1


class Menon(IntEnum):
    """Steps of Menon's demosaicing, in their order."""

    DIFFERENCES = 0  # green less own colour, along rows and columns
    GREEN = 1  # the direction whose differences change less
    AT_GREEN = 2  # red and blue where green was measured
    AT_CHROMA = 3  # red where blue was measured, and blue where red was
    REFINE_GREEN = 4
    REFINE_AT_GREEN = 5
    REFINE_AT_CHROMA = 6


# Pixels at the border of planes that each of Menon's steps leaves out.
MENON_MARGINS = (2, 6, 7, 8, 9, 10, 11)


# Merging of exposures.
FADE = 16.0  # linear values lose their weight over the last sixteenth below saturation
FAINTEST = 1e-30  # light, and sums of weights, are at least this before a logarithm or a division
MIDDLE = 128  # a code below this, seen by no exposure with a weight, is taken for too dark


class Step(IntEnum):
    """Steps of the residual interpolation of red or blue, in their order."""

    DEVIATIONS = 0  # from the means of windows, at the samples
    WINDOWS = 1  # the line of each window, and its weight
    TENTATIVE = 2  # the mean line at each pixel, and what it leaves
    DIAGONAL = 3  # what is left, between four samples
    RESIDUAL = 4  # the same between two samples, and the colour


BORDER = 26  # pixels at the border of planes whose green is not found
# Pixels at their border that a step towards red or blue leaves out.
MARGINS = {
    Step.DEVIATIONS: 28,
    Step.WINDOWS: 31,
    Step.TENTATIVE: 34,
    Step.DIAGONAL: 37,
    Step.RESIDUAL: 39,
}
STRIP = 256  # rows that Menon's steps take at once on the CPU: even
MARGIN = 40  # pixels by which planes are extended: even, so that colours stay where they are
# Residual interpolation: what the slope's prior weighs along rows and columns, and in windows.
PRIOR, WINDOW_PRIOR = 1.0, 0.3
FLOOR = 0.5 / 128**2  # variance that is always there, as a share of the squared means of both
SMOOTH = 0.2  # how much texture speaks for smooth differences of colours
FLAT = 1e-6  # change of these differences that does not count, as a share of the squared sample
STEADY = 0.08  # change of what lines leave that does not count, as a share of green
TINY = 1e-30
SETTLED = 1e-12  # estimates below it are rounding errors of zeros, which kernel sets do not share
# Tone: weights of linear sRGB in luminance, the logarithm of no light, and steps of logarithms in
# sums, whose terms are integers.
LUMINANCE = 0.2126, 0.7152, 0.0722
UNSEEN = -1000.0
STEPS = 2**20
SLOTS = 1024  # sums that are added up on the host
EDGE = 0.05  # difference of scales that is an edge [Reinhard 2002]
# Fusion: deviation of how well a value is exposed about the middle, distance from 0 and 1 at which
# values are held back, and what is added to each weight.
WELL, KNEE, LEAST = 0.2, 0.05, 1e-12
# Alignment: levels of grey, and moves of one pixel, the shortest first.
GREYS = 2**16
GROUP = 2**8  # levels that are added up together
PARTS = 32  # sums of each count of pixels that differ
MOVES = ((0, 0), (-1, 0), (0, -1), (0, 1), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))
