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
        low, high = (
            [int(np.floor(F32(c + side * half) + F32(0.5))) for c in (v, u)]
            for side in (F32(-1), 1)
        )
        high = [max(h, l + 1) for l, h in zip(low, high, strict=True)]
        area = np.s_[max(low[0], 0) : max(high[0], 0), max(low[1], 0) : max(high[1], 0)]
        key = (np.int64(depth.view(np.int32)) << np.int64(32)) | np.int64(i)
        keys[area] = np.minimum(keys[area], key)
    return keys


def shade(keys, colors, background, samples):
    """Return the mean colour of the samples of each pixel, halves rounded up."""
    shown = np.where(
        (keys == FAR)[..., None], background, colors[(keys & 0x7FFFFFFF) % len(colors)]
    )
    height, width = keys.shape
    blocks = shown.reshape(height // samples, samples, width // samples, samples, 3)
    return np.floor(blocks.mean((1, 3)) + 0.5).astype(np.uint8)
