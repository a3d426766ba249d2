"""Every public function of an image, called with nothing but an image, and images to call it on."""

import importlib
import inspect
import pkgutil
from typing import Any

import numpy as np

import cvkern
import cvkern.radiance
from cvkern.kernels.codes.filters import Border

MODES = [border.name.lower() for border in Border]


def edges(image):
    """Return a mask that every library's array gives, of the same library."""
    return cvkern.canny(image, 1.5, 16, 32)


# A ring that is no circle, as a table of shapes.
_TURNS = np.linspace(-3, 3, 40)
_RADII = 9 + 3 * np.cos(3 * _TURNS)
TABLE = cvkern.RTable(
    (np.stack((np.sin(_TURNS), np.cos(_TURNS)), 1) * _RADII[:, None]).astype("f4"),
    _TURNS.astype("f4"),
    np.array([9.0, 9.0]),
    (19, 19),
)
REPROJECTION = cvkern.reprojection_matrix(700.0, 0.12, 20.5, 10.25, 3.5)


def _samples(image):
    """Take an image for samples of rays: densities, colours, distances and lengths, and spans."""
    return image[:, 0], image[:, :3], image[:, 3:5], np.array([[0, 5], [5, 0], [5, 7]], np.int32)


CALLS = {
    "gaussian": lambda x: cvkern.gaussian(x, 1.5),
    "derivative": lambda x: cvkern.gaussian(x, (1.0, 2.0), order=(0, 1)),
    "correlate_separable": lambda x: cvkern.correlate_separable(x, ([1, -2, 0.5], [0.25, 3, 1])),
    "box": lambda x: cvkern.box(x, (1, 3)),
    "median": lambda x: cvkern.median(x, 2),
    "sobel": cvkern.sobel,
    "scharr": lambda x: cvkern.scharr(x, axis=1),
    "gradient": lambda x: cvkern.gradient(x, sigma=1.5),
    "gradient_sobel": lambda x: cvkern.gradient(x, sigma=0, operator="sobel"),
    "canny": lambda x: cvkern.canny(x, 1.5, use_quantiles=True, low_threshold=0.5),
    "canny_sectors": lambda x: cvkern.canny(x, 0, 100, 200, suppression="sectors"),
    "canny_gaussian": lambda x: cvkern.canny(
        x, 1.2, 0.7, 0.9, use_quantiles=True, operator="gaussian", mode="nearest"
    ),
    "subpixel_edges": lambda x: cvkern.subpixel_edges(x, 1.5, 16, 32),
    "hough_circle": lambda x: cvkern.hough_circle(edges(x), [3, 6, 11]),
    "hough_circle_peaks": lambda x: cvkern.hough_circle_peaks(
        cvkern.hough_circle(edges(x), [3, 6]), [3, 6], 2, 3
    ),
    "hough_line": lambda x: cvkern.hough_line(edges(x)).votes,
    "hough_line_slope": lambda x: cvkern.hough_line_slope(edges(x)).swapped,
    "hough_line_peaks": lambda x: cvkern.hough_line_peaks(*cvkern.hough_line(edges(x))).votes,
    "hough_line_segments": lambda x: cvkern.hough_line_segments(
        edges(x), *cvkern.hough_line_peaks(*cvkern.hough_line(edges(x)))[1:], min_length=2
    ),
    "detect_lines": lambda x: cvkern.detect_lines(x, min_votes=5).votes,
    "detect_segments": lambda x: cvkern.detect_segments(x, min_length=4),
    "detect_circles": lambda x: cvkern.detect_circles(x, (4, 16), min_support=0.2),
    "disparity_to_depth": lambda x: cvkern.disparity_to_depth(x, 700.0, 0.12, 3.5),
    "points_from_disparity": lambda x: cvkern.points_from_disparity(x, REPROJECTION),
    "left_right_check": lambda x: cvkern.left_right_check(x, x, tolerance=3),
    "remove_speckles": lambda x: cvkern.remove_speckles(x, 9, difference=3),
    "fill_disparity": cvkern.fill_disparity,
    "stereo_match": lambda x: cvkern.stereo_match(x, x, (1, 9), data_range=255, speckle_size=5),
    "radiance.composite_rays": lambda x: cvkern.radiance.composite_rays(*_samples(x)),
    "radiance.composite_rays_backward": lambda x: cvkern.radiance.composite_rays_backward(
        cvkern.radiance.Composite(x[:3, :3], x[:3, 0], None, x[:3, 2]), *_samples(x)
    ),
}
ROUNDED = {name for name in CALLS if name.startswith("radiance.")}  # equal to rounding only

DTYPES = ["bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
          "float16", "float32", "float64"]  # fmt: skip


def fields(answer):
    """Return the arrays of a result, be it one or a named tuple."""
    return answer if isinstance(answer, tuple) else (answer,)


def primitives(kernel_set):
    """Yield (module, name, function) of each primitive of a kernel set."""
    package = importlib.import_module(f"cvkern.kernels.{kernel_set}")
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if "._" in info.name:
            continue
        module = importlib.import_module(info.name)
        for name, function in inspect.getmembers(module, inspect.isfunction):
            if function.__module__ == module.__name__ and not name.startswith("_"):
                yield module, name, function


def is_fact(function):
    """Tell whether a function of a kernel module launches nothing, and returns a limit or bytes."""
    return inspect.signature(function).return_annotation is int


def noise(*shape: int, dtype: Any = "float32", seed: int = 0) -> np.ndarray:
    """Return uniform values: over [0, 1) for floats, from small ones on over the range else."""
    rng, dtype = np.random.default_rng(seed), np.dtype(dtype)
    if dtype.kind == "f":
        return rng.random(shape).astype(dtype)
    if dtype.kind == "b":
        return rng.random(shape) < 0.5
    info = np.iinfo(dtype)
    return rng.integers(info.min, info.max, shape, dtype, endpoint=True)


def blobs(*shape: int, seed: int = 0) -> np.ndarray:
    """Return a uint8 picture of soft blobs on noise: edges long and short, flat parts, ties."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    picture = rng.normal(100, 4, shape)
    for _ in range(1 + shape[0] * shape[1] // 400):
        cy, cx, r = rng.uniform(0, shape[0]), rng.uniform(0, shape[1]), rng.uniform(3, 15)
        distance = np.hypot(y - cy, x - cx)
        picture += rng.uniform(-45, 45) * (1 - np.tanh(distance - r))
    picture[: shape[0] // 8] = 255
    return picture.clip(0, 255).astype(np.uint8)


def layouts(image, folder):
    """Yield (name, array) with the values of a 2-D image, differently laid out in memory."""
    yield "reversed", image[::-1, ::-1].copy()[::-1, ::-1]
    yield "strided", np.repeat(np.repeat(image, 2, 0), 3, 1)[::2, ::3]
    yield "fortran", np.asfortranarray(image)
    yield "transposed", np.ascontiguousarray(image.T).T
    yield "swapped", image.astype(image.dtype.newbyteorder())
    frozen = image.copy()
    frozen.flags.writeable = False
    yield "read-only", frozen
    unaligned = np.zeros(image.nbytes + 1, np.uint8)[1:].view(image.dtype).reshape(image.shape)
    unaligned[...] = image
    yield "unaligned", unaligned
    mapped = np.memmap(folder / "image", image.dtype, "w+", shape=image.shape)
    mapped[...] = image
    mapped.flush()
    yield "memmap", np.memmap(folder / "image", image.dtype, "r", shape=image.shape)
