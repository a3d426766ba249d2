"""Refinement of disparity maps, in Taichi; NaN means that there is no disparity."""
