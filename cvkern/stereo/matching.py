"""Dense stereo: from a rectified pair to disparities."""

from __future__ import annotations

from typing import Any, NamedTuple

from cvkern._arrays import library
from cvkern._checks import check_axes, check_image
from cvkern._runtime import runtime
from cvkern._whites import white_of_all
from cvkern.stereo._plan import plan_of


class StereoResult(NamedTuple):
    """The result of matching, for each pixel of the left image."""

    disparity: Any
    """Pixels, (H, W) float32; filled where it is not valid."""
    valid: Any
    """Whether the disparity was found by matching, not filled in; (H, W) bool."""
    confidence: Any
    """1 minus the winner's cost over the cost of its best rival, for valid and other pixels;
    (H, W) float32."""


def stereo_match(
    left: Any,
    right: Any,
    disparities: tuple[int, int] = (0, 64),
    *,
    method: str = "semi-global",
    paths: int = 8,
    window: int = 11,
    channel_axis: int | None = None,
    data_range: float | None = None,
    p1: int = 20,
    p2: int = 80,
    contrast: float = 20.0,
    subpixel: bool | str = "equiangular",
    uniqueness: int = 0,
    left_right: float | None = 1.0,
    speckle_size: int = 100,
    speckle_difference: float = 2.0,
    smoothing: int = 6,
    max_bytes: int | None = None,
    batch_axis: int | None = None,
) -> StereoResult:
    """Find the disparity of each pixel of a rectified pair.

    The pixel (y, x) of the left image is matched with (y, x - d) of the right one. The steps are:
    costs of all disparities d, choice of the winner, a check from the right image, removal of
    speckles, filling from the background, and a median guided by the image.

    Parameters
    ----------
    left, right : array of shape (H, W), or with 3 or 4 channels, or stacks of them
        A rectified pair. Matching uses 8-bit grey values; those of a colour image are
        ``(77 R + 150 G + 29 B + 128) >> 8``. A fourth channel is ignored.
    disparities : (int, int), default (0, 64)
        The first disparity d, and the one after the last, as in :class:`range`; both may be
        negative.
    method : {'semi-global', 'window'}, default 'semi-global'
        'semi-global' is described in the Notes; 'window' compares the census in windows, which is
        faster and coarser.
    paths : {4, 8, 16}, default 8
        Directions of semi-global paths.
    window : int, default 11
        Odd side of the windows of the method 'window', 1 to 51. A small window keeps detail and
        noise; a large one smooths and makes near objects wider.
    channel_axis : int, optional
        Axis of the channels; by default the last of (H, W, 3 or 4).
    data_range : float, optional
        The value of white. By default 255 for bytes and 1 for floating-point images; for wider
        integers, and floating-point images with a mean above 1, the smallest of 2^8 - 1,
        2^10 - 1, 2^12 - 1 and so on that no value exceeds.
        A captured call knows only the dtype: its white is the largest integer, or 1. Values below
        0 count as black, values above white as white.
    p1 : int, default 20
        Penalty of a path for a change of disparity by one; costs are 0 to 54.
    p2 : int, default 80
        Penalty for a larger change.
    contrast : float, default 20.0
        Difference of neighbours in the left image that halves `p2`.
    subpixel : bool or {'parabola', 'equiangular'}, default 'equiangular'
        As in :func:`winner_take_all`. Hamming distances grow linearly, like absolute differences,
        so two lines fit them better than a parabola.
    uniqueness : int, default 0
        As in :func:`winner_take_all`, in per cent.
    left_right : float or None, default 1.0
        The tolerance of :func:`left_right_check`, in pixels. None omits the check.
    speckle_size : int, default 100
        Regions of fewer pixels are not valid, as in :func:`remove_speckles`; at most 1 keeps all.
    speckle_difference : float, default 2.0
        Largest difference of neighbours in a region, in pixels.
    smoothing : int, default 6
        Radius of :func:`guided_median`, 0 to 15; 0 omits it.
    max_bytes : int, optional
        Bound on the memory of semi-global matching; none by default. If its volumes take more
        bytes, the work is done in strips of rows, as in :func:`aggregate_semi_global`.
    batch_axis : {0}, optional
        Axis of the pairs in stacks. They are matched one after the other, with the memory of one.

    Returns
    -------
    StereoResult
        Named tuple of `disparity` (H, W) float32, `valid` (H, W) bool and `confidence` (H, W)
        float32, each (N, H, W) of stacks. Disparities are NaN only if no pixel of the image is
        valid.

    Raises
    ------
    TypeError
        If an image does not hold real numbers, or an option is not of its type.
    ValueError
        If the images are empty, have another rank or number of channels, or different shapes; if
        `disparities` are empty, as large as the image's width on either side, or too many (the
        message states the bytes they would take); if a penalty is negative, `p1` above `p2`, or
        the penalties so large that 16-bit sums overflow; or if another option is out of its range.

    Notes
    -----
    The cost of the method 'semi-global' has two terms: twice the Hamming distance of two census
    transforms of 5 x 5 pixels, plus half the difference of the grey values, but at most 6. Its
    sums over the paths [1]_ are those of :func:`aggregate_semi_global` with the left image as
    guide.

    All arithmetic up to the sub-pixel fit is in integers, and the fit has the same bits everywhere.
    So the result is the same on every device and kernel set.

    References
    ----------
    .. [1] H. Hirschmueller, "Stereo processing by semiglobal matching and mutual information",
       IEEE PAMI 30(2), 2008.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> right = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
    >>> left = np.roll(right, 5, axis=1)
    >>> result = cvkern.stereo_match(left, right, (0, 16))
    >>> float(np.median(result.disparity).round(1))
    5.0
    """
    options = locals()
    ranks = (2, 3) if batch_axis is None else (3, 4)
    left = check_image(left, ndim=ranks, name="left")
    right = check_image(right, ndim=ranks, name="right")
    if tuple(left.shape) != tuple(right.shape):
        raise ValueError(
            f"right must have the shape of left, {tuple(left.shape)}, got {tuple(right.shape)}"
        )
    if library(left).dtype(left) == library(right).dtype(right):
        options["data_range"] = white_of_all((left, right), data_range)
    rt = runtime(left, right)
    one = tuple(left.shape)
    stack: tuple[int, ...] = ()
    if batch_axis is not None:
        if channel_axis is None and len(one) == 4:
            channel_axis = -1
        options["channel_axis"] = check_axes(one, channel_axis, batch_axis)
        stack, one = one[:1], one[1:]
    plan = plan_of(rt, one, options)
    shape = (*stack, *plan.images.shape)
    result = StereoResult(rt.empty(shape), rt.empty(shape, bool), rt.empty(shape))
    arrays = (
        left, right,
        rt.adopt(result.disparity), rt.adopt(result.valid, bool), rt.adopt(result.confidence),
    )  # fmt: skip
    if batch_axis is None:
        plan.match(rt, *arrays)
    else:
        for n in range(left.shape[0]):
            plan.match(rt, *(a[n] for a in arrays))
    return StereoResult(*(rt.release(a) for a in result))
