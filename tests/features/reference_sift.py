"""SIFT as a plain NumPy statement in float64, after Lowe 2004."""

import numpy as np
import scipy.ndimage as ndi

BLUR, TRUNCATE, MARGIN = 0.2, 3.5, 5


def doubled(image):
    """Put the pixels on even places, means between them."""
    for axis in (0, 1):
        after = np.concatenate((image, image.take([-1], axis)), axis).take(
            np.arange(1, image.shape[axis] + 1), axis
        )
        image = np.stack((image, (image + after) / 2), axis + 1)
        shape = list(image.shape)
        shape[axis : axis + 2] = [shape[axis] * 2]
        image = image.reshape(shape)
    return image


def blurred(image, sigma):
    return ndi.gaussian_filter(image, sigma, mode="mirror", truncate=TRUNCATE)


def scale_space(image, levels=3, sigma=1.6):
    """Yield (levels, pixels of the image per pixel) of each octave."""
    base, step = doubled(image.astype(float)), 0.5
    base = blurred(base, np.sqrt(sigma**2 - (BLUR / step) ** 2))
    while min(base.shape) >= 12 or step == 0.5:
        stack = [base]
        for i in range(1, levels + 3):
            one, other = (sigma * 2 ** ((i - k) / levels) for k in (0, 1))
            stack.append(blurred(stack[-1], np.sqrt(one**2 - other**2)))
        yield np.stack(stack), step
        base, step = (
            stack[levels][: len(base) // 2 * 2 : 2, : len(base[0]) // 2 * 2 : 2],
            2 * step,
        )


def keypoints(image, levels=3, sigma=1.6, contrast=0.04, edge=10.0):
    """Return rows, columns, scales, responses of the points of an image of values in [0, 1]."""
    found = []
    for stack, step in scale_space(image, levels, sigma):
        d = np.diff(stack, axis=0)
        high = (d == ndi.maximum_filter(d, 3)) & (d > 0.5 * contrast / levels)
        low = (d == ndi.minimum_filter(d, 3)) & (d < -0.5 * contrast / levels)
        inner = np.zeros(d.shape, bool)
        inner[1:-1, MARGIN:-MARGIN, MARGIN:-MARGIN] = True
        kept = {}
        for s, y, x in np.argwhere((high | low) & inner):
            for _ in range(5):
                c = d[s - 1 : s + 2, y - 1 : y + 2, x - 1 : x + 2]
                g = np.array([c[2, 1, 1] - c[0, 1, 1], c[1, 2, 1] - c[1, 0, 1],
                              c[1, 1, 2] - c[1, 1, 0]]) / 2  # fmt: skip
                h = np.empty((3, 3))
                for i, (p, q) in enumerate(((c[0, 1, 1], c[2, 1, 1]), (c[1, 0, 1], c[1, 2, 1]),
                                            (c[1, 1, 0], c[1, 1, 2]))):  # fmt: skip
                    h[i, i] = p + q - 2 * c[1, 1, 1]
                h[0, 1] = h[1, 0] = (c[2, 2, 1] - c[2, 0, 1] - c[0, 2, 1] + c[0, 0, 1]) / 4
                h[0, 2] = h[2, 0] = (c[2, 1, 2] - c[2, 1, 0] - c[0, 1, 2] + c[0, 1, 0]) / 4
                h[1, 2] = h[2, 1] = (c[1, 2, 2] - c[1, 2, 0] - c[1, 0, 2] + c[1, 0, 0]) / 4
                off = -np.linalg.solve(h, g)
                if (np.abs(off) < 0.5).all():
                    top = c[1, 1, 1] + g @ off / 2
                    trace, det = h[1, 1] + h[2, 2], h[1, 1] * h[2, 2] - h[1, 2] ** 2
                    round_enough = det > 0 and trace**2 * edge < (edge + 1) ** 2 * det
                    if abs(top) * levels >= contrast and round_enough:
                        place = np.array([y, x]) + off[1:]
                        scale = sigma * 2 ** ((s + off[0]) / levels)
                        kept[s, y, x] = (*(place * step), scale * step, abs(top))
                    break
                if (np.abs(off) >= 3).any():
                    break
                s, y, x = np.array([s, y, x]) + np.floor(off + 0.5).astype(int)
                if not inner[s, y, x] if 0 <= s < len(d) else True:
                    break
        found += [kept[key] for key in sorted(kept)]
    return np.array(found).reshape(-1, 4)


def descriptor(image, point, scale, angle, root):
    """Describe one point: 16 cells of 8 directions, weighed and shared linearly."""
    stack, step, s = np.zeros(0), 0.0, 0
    for stack, step in scale_space(image):  # noqa: B007  (the octave of the break is looked at)
        s = round(3 * np.log2(scale / step / 1.6))
        if 1 <= s <= 3:
            break
    level, side = stack[s], 3 * scale / step
    cy, cx = (int(np.floor(p / step + 0.5)) for p in point)
    radius = int(side * np.sqrt(2) * 2.5 + 0.5)
    sums = np.zeros((6, 6, 8))
    for y in range(max(cy - radius, 1), min(cy + radius, level.shape[0] - 2) + 1):
        for x in range(max(cx - radius, 1), min(cx + radius, level.shape[1] - 2) + 1):
            i, j = y - cy, x - cx
            r = (i * np.cos(angle) - j * np.sin(angle)) / side + 1.5
            c = (i * np.sin(angle) + j * np.cos(angle)) / side + 1.5
            if not (-1 < r < 4 and -1 < c < 4):
                continue
            dy = level[y + 1, x] - level[y - 1, x]
            dx = level[y, x + 1] - level[y, x - 1]
            o = (np.arctan2(dy, dx) - angle) * 8 / (2 * np.pi) % 8
            v = np.hypot(dy, dx) * np.exp(-(i * i + j * j) / (8 * side * side))
            for a in (0, 1):
                for b in (0, 1):
                    for e in (0, 1):
                        r0, c0, o0 = (int(np.floor(t)) for t in (r, c, o))
                        share = (
                            abs(1 - a - (r - r0)) * abs(1 - b - (c - c0)) * abs(1 - e - (o - o0))
                        )
                        sums[r0 + a + 1, c0 + b + 1, (o0 + e) % 8] += v * share
    found = sums[1:5, 1:5].ravel()
    found = np.minimum(found, 0.2 * np.linalg.norm(found))
    found = np.sqrt(found / found.sum()) if root else found / np.linalg.norm(found)
    return np.minimum(512 * found + 0.5, 255).astype(int)
