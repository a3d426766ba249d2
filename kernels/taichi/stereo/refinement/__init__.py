"""Refinement of disparity maps, in Taichi; NaN stands for no disparity."""
