"""The largest rectangle within a panorama."""

from __future__ import annotations

import math

import numpy as np

EXACT_PIXELS = 250_000  # larger masks are searched in blocks of pixels


def largest_rectangle(mask: np.ndarray) -> tuple[int, int, int, int]:
    """Return the first row and column, and those behind the last, of covered pixels alone.

    Of masks of more than `EXACT_PIXELS` blocks are searched that are covered as a whole. Of equal
    rectangles the one found first wins, from the top; nothing covered gives the whole mask.
    """
    size = max(1, math.ceil(math.sqrt(mask.size / EXACT_PIXELS)))
    height, width = (n // size for n in mask.shape)
    blocks = mask[: height * size, : width * size].reshape(height, size, width, size)
    whole = np.asarray(blocks.all(axis=(1, 3)))
    best, found = 0, (0, 0, mask.shape[0], mask.shape[1])
    heights = np.zeros(width + 1, np.int64)
    for row in range(height):
        heights[:width] = np.where(whole[row], heights[:width] + 1, 0)
        if int(heights.max()) * width <= best:
            continue
        area, left, right, tall = _in_histogram(heights.tolist())
        if area > best:
            best = area
            found = ((row + 1 - tall) * size, left * size, (row + 1) * size, right * size)
    return found


def _in_histogram(heights: list[int]) -> tuple[int, int, int, int]:
    """Return area, left, right and height of the largest rectangle under bars; the last is 0."""
    best = (0, 0, 0, 0)
    stack: list[tuple[int, int]] = []  # where a height begins, ascending heights
    for place, height in enumerate(heights):
        begin = place
        while stack and stack[-1][1] >= height:
            begin, tall = stack.pop()
            area = tall * (place - begin)
            if area > best[0]:
                best = (area, begin, place, tall)
        stack.append((begin, height))
    return best
