"""Pictures of points in NumPy: float32 in the order of the kernels, one point after another."""

import numpy as np

F32 = np.float32
FAR = np.iinfo(np.int64).max


def splat(points, pose, focal, cx, cy, size, shape):
    """Return the key of each sample: the bits of the least depth, then the first of its points."""
    focal, cx, cy, size = map(F32, (focal, cx, cy, size))
    keys = np.full(shape, FAR)
    for i, (x, y, z) in enumerate(points):
        a, b, depth = (m[0] * x + m[1] * y + m[2] * z + m[3] for m in pose)
        if not (z > 0 and depth > 0):
            continue
        u, v = a / depth * focal + cx, b / depth * focal + cy
        half = F32(0.5) * min(z / depth * size, F32(64))
        key = (np.int64(depth.view(np.int32)) << np.int64(32)) | np.int64(i)
        area = np.ix_(*(covered(c, half, side) for c, side in zip((v, u), shape, strict=True)))
        keys[area] = np.minimum(keys[area], key)
    return keys


def covered(middle, half, side):
    """Return the samples whose centres lie in the square, or the nearest one."""
    centers = np.arange(-70, side + 70).astype(F32)
    inside = (centers >= F32(middle - half)) & (centers < F32(middle + half))
    if not inside.any():
        inside = centers == np.floor(F32(middle + F32(0.5)))
    found = centers[inside].astype(int)
    return found[(found >= 0) & (found < side)]


def shade(keys, colors, background, samples):
    """Return the mean colour of the samples of each pixel, halves rounded up."""
    shown = np.where(
        (keys == FAR)[..., None], background, colors[(keys & 0x7FFFFFFF) % len(colors)]
    )
    height, width = keys.shape
    blocks = shown.reshape(height // samples, samples, width // samples, samples, 3)
    return np.floor(blocks.mean((1, 3)) + 0.5).astype(np.uint8)
