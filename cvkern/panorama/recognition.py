"""Which images of a heap belong together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from cvkern.panorama.registration import (
    Progress,
    check_heap,
    connected,
    link_images,
    make_small,
)


class Recognition(NamedTuple):
    """The panoramas of a heap of images."""

    components: list[list[int]]
    """Indices of the images of each panorama, ascending: the largest panorama first, of equal
    ones that of the least index. A stranger is a component of one."""
    pairs: list[tuple[int, int]]
    """The pairs of images that show the same, i < j, ascending."""


def recognize_panoramas(
    images: Sequence[Any],
    *,
    data_range: float | None = None,
    progress: Progress | None = None,
) -> Recognition:
    """Find which images of an unordered heap belong to one panorama.

    Keypoints of all images are matched between all pairs, and a homography is looked for in each
    pair. Two images show the same if more than 8 + 0.3 n matches agree with it, where n is the
    number of all matches that fall in the overlap. What is connected by such pairs is a panorama.

    Parameters
    ----------
    images : sequence of arrays of shape (H, W), (H, W, 3) or (H, W, 4)
        Of any real dtypes and of various sizes. Those of more than 0.6 megapixels are compared at
        that size.
    data_range : float, optional
        What white is; for integers the largest number of the dtype by default, else 1.
    progress : function, optional
        Called with the number of steps done, the number of all, and what comes next.

    Returns
    -------
    Recognition
        Named tuple of `components` and `pairs`.

    Raises
    ------
    TypeError
        If an image does not hold real numbers.
    ValueError
        If there are no images, one is empty or of another shape, `data_range` is not above 0, or
        the arrays are on several devices.

    References
    ----------
    .. [1] M. Brown and D. Lowe, "Automatic panoramic image stitching using invariant features",
       IJCV 74(1), 2007, section 3.2.

    Examples
    --------
    >>> from skimage import data
    >>> import cvkern
    >>> wide, other = data.coffee(), data.camera()
    >>> heap = [wide[:, :350], other, wide[:, 250:]]
    >>> cvkern.recognize_panoramas(heap)
    Recognition(components=[[0, 2], [1]], pairs=[(0, 2)])
    """
    heap = make_small(check_heap(images, data_range), data_range)
    links = link_images(heap, progress or silent)
    pairs = [(link.first, link.second) for link in links]
    return Recognition(connected(len(heap.images), pairs), pairs)


def silent(done: int, total: int, text: str) -> None:
    """Say nothing."""
