"""Strips of rows, which keep the work on a large volume within a number of bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cvkern._checks import check_integer

OVERLAP = 64  # rows of each neighbouring strip that a strip also reads
_FEWEST = 64  # smallest number of rows of a strip; with fewer, most of its work would be overlap


class Strip(NamedTuple):
    """Rows of an image that are filled, and the rows that are read for them."""

    top: int
    bottom: int
    first: int
    last: int
    height: int

    @property
    def margin(self) -> int:
        """Number of rows that are read above the filled ones."""
        return self.top - self.first

    def seen_of(self, array: Any) -> Any:
        """Return the rows of `array` that are read; `array` itself if these are all."""
        return array if self.last - self.first == self.height else array[self.first : self.last]

    def kept_of(self, array: Any) -> Any:
        """Return the rows of `array` that are filled; `array` itself if these are all."""
        return array if self.bottom - self.top == self.height else array[self.top : self.bottom]


def cut_strips(
    height: int,
    fixed: int,
    work: Callable[[int], int],
    max_bytes: int | None,
    subject: str,
) -> list[Strip]:
    """Cut `height` rows so that `fixed` plus ``work(rows read)`` is at most `max_bytes`.

    Raises
    ------
    TypeError
        If `max_bytes` is neither None nor an integer.
    ValueError
        If `max_bytes` is too small for the smallest strips.
    """
    rows = height
    if max_bytes is not None:
        max_bytes = check_integer(max_bytes, "max_bytes", 0, 2**63 - 1)
        if fixed + work(height) > max_bytes:
            fewest = min(_FEWEST, height)
            least = fixed + work(min(height, fewest + 2 * OVERLAP))
            if least > max_bytes:
                raise ValueError(
                    f"max_bytes must be at least {least} for {subject}, got {max_bytes}"
                )
            rows = max(
                n
                for n in range(fewest, height)
                if fixed + work(min(height, n + 2 * OVERLAP)) <= max_bytes
            )
    tops = range(0, height, rows)
    return [
        Strip(
            top,
            min(height, top + rows),
            max(0, top - OVERLAP),
            min(height, top + rows + OVERLAP),
            height,
        )
        for top in tops
    ]
