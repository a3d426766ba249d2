"""Dense stereo of a video: all memory is allocated once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cvkern._arrays import device, library
from cvkern._capture import capture
from cvkern._checks import MAX_ELEMENTS, as_items, check_image, check_integer
from cvkern._runtime import pinned, runtime
from cvkern._whites import white_of_all
from cvkern.geometry.cameras.rectification import Rectification, rectify_stereo
from cvkern.geometry.cameras.stereo_calibration import StereoCalibration
from cvkern.stereo._plan import plan_of
from cvkern.stereo.depth import disparity_to_depth
from cvkern.stereo.matching import stereo_match


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
    The first pair sets the library, device and dtype of all pairs and, without `data_range`, their
    white; give `data_range` if later frames of more than 8 bits may be brighter. Only one thread
    at a time may use a matcher.

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
        range_ = white_of_all((left, right), options["data_range"])
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
