"""Constants of structured light."""

MOST_BITS = 16  # in the Gray code of one axis: a projector has at most 2^16 rows or columns
NONE = -1  # the code of a pixel that saw no pattern
MOST_MOVES = 6  # largest distance in pixels of a ridge from the brightest position
LEAST_BEND = 1e-18  # smaller second derivatives count as 0, for their squares are denormal
MOST_OFFSET = 0.75  # largest distance in pixels of a ridge from the middle of its pixel

LENS_STEPS = 4  # iterations for the point on a column that the projector's lens bends
