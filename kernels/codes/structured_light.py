"""Constants of structured light."""

MOST_BITS = 16  # in the Gray code of one axis: a projector has at most 2^16 rows or columns
NONE = -1  # the code of a pixel that saw no pattern
MOST_MOVES = 6  # pixels that the search for a ridge moves on from the brightest place
LEAST_BEND = 1e-18  # smaller second derivatives count as 0, for their squares are denormal
MOST_OFFSET = 0.75  # pixels from a ridge to the middle of the pixel that tells it

LENS_STEPS = 4  # times that a point is looked for along a line that a projector's lens bends
