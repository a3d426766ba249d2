"""Dense stereo: from a rectified pair to disparities."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import device, library
from cvkern._capture import capture
from cvkern._checks import MAX_ELEMENTS, as_items, check_axes, check_image, check_integer
from cvkern._runtime import Runtime, pinned, runtime
from cvkern.geometry.cameras.rectification import Rectification, rectify_stereo
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration
from cvkern.stereo._plan import plan_of, white
from cvkern.stereo.depth import disparity_to_depth


class StereoResult(NamedTuple):
    """The result of matching, for each pixel of the left image."""

    disparity: Any
    """Pixels, (H, W) float32; filled where it is not valid."""
    valid: Any
    """Whether the disparity was found by matching, not filled in; (H, W) bool."""
    confidence: Any
    """1 minus the winner's cost over the cost of its best rival, for valid and other pixels;
    (H, W) float32."""


class DepthFrame(NamedTuple):
    """What is known of each pixel of the rectified left image."""

    disparity: Any
    """Pixels, (H, W) float32; filled where it is not valid."""
    valid: Any
    """Whether the disparity was found, and not filled; (H, W) bool."""
    confidence: Any
    """As in :class:`StereoResult`, (H, W) float32."""
    depth: Any
    """Distance along the optical axis in the unit of the calibration, (H, W) float32; infinite
    where the disparity is 0."""
    image: Any
    """The rectified left image, of the shape of the frames."""


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
        The value of white, for dtypes other than uint8. By default the largest value of an integer
        dtype, and 1 for floating-point images. Values below 0 count as black, values above white
        as white.
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
    rt = runtime(left, right)
    if batch_axis is not None:
        if channel_axis is None and len(left.shape) == 4:
            channel_axis = -1
        options["channel_axis"] = check_axes(left.shape, channel_axis, batch_axis)
        return _match_stack(rt, left, right, options)
    plan = plan_of(rt, tuple(left.shape), options)
    shape = plan.images.shape
    result = StereoResult(rt.empty(shape), rt.empty(shape, bool), rt.empty(shape))
    plan.match(
        rt, left, right,
        rt.adopt(result.disparity), rt.adopt(result.valid, bool), rt.adopt(result.confidence),
    )  # fmt: skip
    return StereoResult(*(rt.release(a) for a in result))


def _match_stack(rt: Runtime, left: Any, right: Any, options: dict[str, Any]) -> StereoResult:
    """Match the pairs of two stacks, one after the other."""
    images, *one = left.shape
    plan = plan_of(rt, tuple(one), options)
    shape = images, *plan.images.shape
    result = StereoResult(rt.empty(shape), rt.empty(shape, bool), rt.empty(shape))
    dtypes = np.float32, bool, np.float32
    filled = [rt.adopt(a, dtype) for a, dtype in zip(result, dtypes, strict=True)]
    for n in range(images):
        plan.match(rt, left[n], right[n], *(a[n] for a in filled))
    return StereoResult(*(rt.release(a) for a in result))


class StereoMatcher:
    """Match the frames of a video: :func:`stereo_match` with all memory allocated once.

    With Warp on CUDA, a frame takes one launch of a CUDA graph.

    Parameters
    ----------
    shape : tuple of int
        Shape of each image: (H, W), or with channels.
    disparities : (int, int), default (0, 64)
        As in :func:`stereo_match`.
    **options
        The other options of :func:`stereo_match`.

    Raises
    ------
    TypeError, ValueError
        As :func:`stereo_match`.

    Notes
    -----
    The first frame sets the library, device and dtype of all frames. Only one thread at a time may
    use a matcher.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> right = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
    >>> with cvkern.StereoMatcher((40, 60), (0, 16)) as matcher:
    ...     for shift in (3, 5):
    ...         left = np.roll(right, shift, axis=1)
    ...         print(np.median(matcher(left, right).disparity).round(1))
    3.0
    5.0
    """

    def __init__(
        self, shape: tuple[int, ...], disparities: tuple[int, int] = (0, 64), **options: Any
    ):
        sides = as_items(shape, "shape", "rows and columns of an image, and channels if it has any")
        self.shape = tuple(check_integer(n, "shape", 1, MAX_ELEMENTS) for n in sides)
        blank = np.broadcast_to(np.uint8(0), self.shape)  # takes no memory
        check_image(blank, ndim=(2, 3), name="shape")
        call = inspect.signature(stereo_match).bind(blank, blank, disparities, **options)
        call.apply_defaults()
        if call.arguments["batch_axis"] is not None:
            raise ValueError("batch_axis must be None: a matcher takes one pair at a time")
        plan_of(runtime(blank), self.shape, call.arguments)
        self._options = call.arguments
        self._match: Callable[..., Any] = stereo_match
        self._open = True
        self._frames: _Frames | None = None
        self.rectification: Rectification | None = None

    @classmethod
    def from_calibration(
        cls,
        calibration: StereoCalibration,
        disparities: tuple[int, int] = (0, 64),
        *,
        keep: str = "valid",
        zoom: float = 1.0,
        **options: Any,
    ) -> StereoMatcher:
        """Return a matcher of raw frames: it rectifies, matches, and finds depths.

        Parameters
        ----------
        calibration : StereoCalibration
            Of :func:`calibrate_stereo` or :func:`read_calibration`.
        disparities : (int, int), default (0, 64)
            As in :func:`stereo_match`, of the rectified images.
        keep, zoom
            As in :func:`rectify_stereo`. With 'valid' no pixel is matched that a camera did not
            see.
        **options
            The other options of :func:`stereo_match`; frames in colour have `channel_axis` -1 and
            three channels.

        Returns
        -------
        StereoMatcher
            Called with two raw frames it gives a :class:`DepthFrame`; `rectification` says how
            they are rectified. With Warp on CUDA all of a frame is one launch of a CUDA graph.

        Raises
        ------
        TypeError, ValueError
            As :func:`rectify_stereo` and :func:`stereo_match`.
        """
        found = rectify_stereo(calibration, keep=keep, zoom=zoom)
        sample, focal, baseline = found.sampler(), found.focal, found.baseline

        def match(left: Any, right: Any, *args: Any, **rest: Any) -> DepthFrame:
            pair = sample(left, right)
            result = stereo_match(*pair, *args, **rest)
            depth = disparity_to_depth(result.disparity, focal, baseline)
            return DepthFrame(*result, depth, pair.left)

        channels = () if options.get("channel_axis") is None else (3,)
        matcher = cls((*calibration.left.shape, *channels), disparities, **options)
        matcher._match = match
        matcher.rectification = found
        return matcher

    def __call__(self, left: Any, right: Any) -> Any:
        """Match a pair.

        Parameters
        ----------
        left, right : array
            Images of the matcher's shape, with the library, device and dtype of the first pair.

        Returns
        -------
        StereoResult or DepthFrame
            The second of a matcher that :meth:`from_calibration` made. On the CPU, and on a GPU if
            the library's arrays can be written to, these are the same arrays each time: copy what
            is to be kept.

        Raises
        ------
        TypeError
            If an image has another dtype or library than the first pair.
        ValueError
            If an image has another shape or device, or the matcher is closed.
        """
        if not self._open:
            raise ValueError("matcher must be open, got one that has been closed")
        left = check_image(left, ndim=(2, 3), name="left")
        right = check_image(right, ndim=(2, 3), name="right")
        for name, image in (("left", left), ("right", right)):
            if tuple(image.shape) != self.shape:
                raise ValueError(f"{name} must have shape {self.shape}, got {tuple(image.shape)}")
        if self._frames is None:
            self._frames = _Frames(left, right, self._match, self._options)
        return self._frames.match(left, right)

    def close(self) -> None:
        """Release the memory; the matcher cannot be used afterwards."""
        self._frames, self._open = None, False

    def __enter__(self) -> StereoMatcher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class _Frames:
    """Two images in persistent memory, and the captured call that matches them."""

    def __init__(self, left: Any, right: Any, match: Callable[..., Any], options: dict[str, Any]):
        self._choice = pinned()
        self._rt = rt = runtime(left, right)
        self._library, self._place = library(left), device(left)
        self._dtype = dtype = self._library.dtype(left)
        self._check(left, right)
        on_cpu = rt.device == "cpu"
        # If kernels cannot write to the caller's arrays, use NumPy's or Warp's instead.
        self._own = self._library.writable and (on_cpu or self._library is not _NUMPY)
        self._kept = rt.result_library()
        self._carried = dtype if on_cpu or dtype == np.uint8 else np.dtype(np.float32)
        shape = tuple(left.shape)
        self._images = [self._kept.empty(shape, self._carried, rt.device) for _ in range(2)]
        self._load(left, right)
        range_ = white(options["data_range"], dtype)
        given = {**options, "left": self._images[0], "right": self._images[1]}
        self._replay = capture(match, **{**given, "data_range": range_})

    def _check(self, left: Any, right: Any) -> None:
        for name, image in (("left", left), ("right", right)):
            given = library(image)
            if given is not self._library or given.dtype(image) != self._dtype:
                raise TypeError(
                    f"{name} must be {self._dtype} of the first frame's library, "
                    f"got {type(image).__name__} of {given.dtype(image)}"
                )
            if device(image) != self._place:
                raise ValueError(f"{name} must be on {self._place}, got {device(image)}")

    def match(self, left: Any, right: Any) -> Any:
        self._check(left, right)
        self._load(left, right)
        result = self._replay()
        return result if self._own else type(result)(*map(self._copied, result))

    def _load(self, left: Any, right: Any) -> None:
        """Copy a pair into the memory that the captured call reads."""
        with self._choice():
            rt = runtime(left, right)
            for kept, image in zip(self._images, (left, right), strict=True):
                there = self._own or self._kept is _NUMPY
                self._kept.fill(kept, image if there else rt.adopt(image, self._carried))

    def _copied(self, array: Any) -> Any:
        """Return a copy of a persistent result, in the caller's library."""
        if self._library is _NUMPY:
            return self._rt.to_numpy(array).copy()
        copy = array.copy() if isinstance(array, np.ndarray) else self._kept.module.clone(array)
        return self._library.finish(copy)


_NUMPY = library(np.empty(0))
