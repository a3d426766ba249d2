"""Refinement of disparity maps, in Warp; NaN stands for no disparity."""
