"""Constants of structured light."""

MOST_BITS = 16  # of the Gray code of one axis: a projector has at most 2^16 rows or columns
NONE = -1  # the code of a pixel that saw no pattern
