"""Refinement of disparity maps, in Warp; NaN means that there is no disparity."""
