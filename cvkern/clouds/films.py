"""Frames as moving pictures: GIF or MP4."""

from __future__ import annotations

import importlib.util
import os
from typing import Any

import numpy as np

from cvkern._checks import as_array, check_positive
from cvkern._files import as_path, check_target, replacing

# A GIF keeps the time of a frame as a 16-bit number of hundredths of a second.
SLOWEST_GIF = 0.0016


def write_animation(path: str | os.PathLike[str], frames: Any, *, fps: float = 20.0) -> None:
    """Write frames as a GIF that repeats forever, or as an MP4, whole or not at all.

    Parameters
    ----------
    path : path
        Ends in ``.gif``, or in ``.mp4`` if imageio-ffmpeg is installed.
    frames : array of shape (F, H, W, 3), uint8
        A GIF has 256 colours in each frame; an MP4 needs an even height and width.
    fps : float, default 20.0
        Frames per second. A GIF counts in hundredths of a second and takes 0.0016 to 50; an MP4
        takes 0.01 to 1000.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    ModuleNotFoundError
        If `path` ends in ``.mp4`` and imageio-ffmpeg is not installed.
    PermissionError
        If nothing can be written in that folder.
    ValueError
        If `path` ends otherwise or is a folder, or `frames` or `fps` is not as above.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from cvkern.clouds import write_animation
    >>> frames = np.zeros((2, 4, 6, 3), np.uint8)
    >>> frames[1] = 255
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_animation(f"{folder}/blink.gif", frames, fps=2)
    ...     Path(folder, "blink.gif").read_bytes()[:6]
    b'GIF89a'
    """
    movie = np.asarray(as_array(frames, "frames"))
    if movie.ndim != 4 or movie.shape[3] != 3 or movie.size == 0 or movie.dtype != np.uint8:
        raise ValueError(
            f"frames must be uint8 of shape (F, H, W, 3), got {movie.dtype} of shape {movie.shape}"
        )
    fps = check_animation(path, movie.shape, fps)
    import imageio.v3 as iio

    with replacing(path) as beside:
        if as_path(path).suffix.lower() == ".gif":
            options = {"plugin": "pillow", "duration": round(1e3 / fps), "loop": 0}
            # Encode in memory, because imageio would write the file again after an error.
            beside.write_bytes(iio.imwrite("<bytes>", movie, extension=".gif", **options))
        else:
            iio.imwrite(beside, movie, plugin="FFMPEG", fps=fps, macro_block_size=2, quality=8)


def check_animation(path: str | os.PathLike[str], shape: tuple[int, ...], fps: Any) -> float:
    """Return `fps` if frames (F, H, W, 3) can be written to `path`; call this before long work.

    The errors are those of :func:`write_animation`.
    """
    suffix = as_path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise ValueError(f"path must end in .gif or .mp4, got {os.fspath(path)!r}")
    check_target(path)
    fps = check_positive(fps, "fps")
    slowest, fastest = (SLOWEST_GIF, 50) if suffix == ".gif" else (0.01, 1000)
    if not slowest <= fps <= fastest:
        raise ValueError(f"fps must be in [{slowest:g}, {fastest}] for {suffix}, got {fps:g}")
    if suffix == ".mp4":
        if shape[1] % 2 or shape[2] % 2:
            raise ValueError(
                f"frames must have an even height and width for .mp4, got shape {shape}"
            )
        if importlib.util.find_spec("imageio_ffmpeg") is None:
            raise ModuleNotFoundError("MP4 needs imageio-ffmpeg: pip install imageio-ffmpeg")
    return fps
