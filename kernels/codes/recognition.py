"""Constants of recognition, and what its kernels take together.

Places in an image are in steps of 1 / `FINE` pixel, scales in steps of 1 / `OCTAVE` octave, and
weights of votes in parts of `ONE`, which is the weight of a patch.
"""

from typing import Any, NamedTuple

WHITE = 4095  # pixels are integers from 0 to this
SPREAD = 32  # value in a normalised patch of what differs from the mean by a standard deviation
LARGEST = 127  # largest value in a normalised patch
PART = 32  # patches are padded with zeros to a multiple of so many bytes
LARGEST_PATCH = 640  # bytes of a patch, with zeros: 25 x 25 pixels
MOST_WORDS = 8  # words that a patch activates, at most

FINE_BITS = 4
FINE = 1 << FINE_BITS
OCTAVE = 64
ONE = 2**16
UNIT = 2**14  # evidence of 1, a factor of e in the odds
SHARE_BITS = 8  # votes for pixels are divided by 2^8, because shares of figures are bytes
FACTOR_BITS = 16  # factors of scale are in parts of 2^16
KERNEL_ONE = 2**10  # value of the kernel of mean shift at its middle
AROUND = 3  # votes are listed in cells that are at most so many from one of a maximum
DEEPEST = 255  # largest radius of that kernel in steps of scale
NOBODY = -1  # match of a patch that activates no further word
CLIMBED = 9  # places that a mode climbs among: its own, and those round it
MOST_HYPOTHESES = 255  # hypotheses above the threshold that are compared with each other


class Occurrences(NamedTuple):
    """Where words were seen about the centre of an object."""

    starts: Any
    """First entry of each word, and the number of all, (K + 1,) int32."""
    entries: Any
    """From the patch to the centre: rows, columns, scale; and a weight, (O, 4) int32.

    Rows and columns are in steps of the patch's own scale.
    """


class Space(NamedTuple):
    """Accumulator of votes: one image of cells per scale."""

    bins: Any
    """First cell, rows, columns, scale and side of the cells of each, (S, 5) int32."""
    slack: int
    """Largest distance of a vote from the scale of its bin."""
    factors: Any
    """Sizes at each scale from `lowest` on, in parts of 2^16, (F,) int32."""
    lowest: int


class Patches(NamedTuple):
    """Patches of an image with their words, by level and row."""

    places: Any
    """Row, column and scale of the centre of each patch, (N, 3) int32."""
    rows: Any
    """Place, first patch and last but one of each row of patches, (R, 3) int32."""
    levels: Any
    """Scale, first row and last but one of each level, (L, 3) int32."""
    matches: Any
    """The words that each patch activates, best first, then `NOBODY`, (N, M) int32."""


class Frame(NamedTuple):
    """The box of an object at scale 0, in places, and its cells of evidence."""

    layers: Any
    """For patches of each size, (B, 6) int32: half height and width of the box in which the middles
    of patches are evidence, at their own scale; cells down and along; scale; first cell."""
    box_height: int
    """Half sizes of the part that an object explains: its whole box."""
    box_width: int


class Window(NamedTuple):
    """The kernel of mean shift."""

    radius: int
    """In places, at scale 0."""
    scales: int
    """Radius in steps of scale, at most `DEEPEST`."""
    rounds: int
    """Most steps of a mode."""
