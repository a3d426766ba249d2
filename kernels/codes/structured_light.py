"""Constants of structured light."""

NONE = -1  # the code of a pixel that saw no pattern
MOST_MOVES = 6  # largest distance in pixels of a ridge from the brightest position
LEAST_BEND = 1e-18  # smaller second derivatives count as 0, for their squares are denormal
MOST_OFFSET = 0.75  # largest distance in pixels of a ridge from the middle of its pixel

LENS_STEPS = 4  # Newton's steps to the point on a column that the projector's lens bends
STILL = 1e-4  # a shorter step of Newton's is the last: its square is below a rounding
NEAR = 1e-3  # largest distance from that column before the last step, of a focal length of 1
