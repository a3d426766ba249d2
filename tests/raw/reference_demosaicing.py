"""Demosaicing in NumPy, float64, with mirrored borders."""

import numpy as np
from scipy.ndimage import convolve, correlate1d


def kinds(shape, pattern):
    """Return masks of the red, green and blue samples."""
    y, x = np.indices(shape)
    cell = np.array(list(pattern)).reshape(2, 2)[y % 2, x % 2]
    return [cell == colour for colour in "RGB"]


def smooth(image, kernel):
    return convolve(image, np.asarray(kernel, float), mode="mirror")


def along(image, weights, axis):
    return correlate1d(image, weights, axis=axis, mode="mirror")


def bilinear(raw, pattern):
    cross = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    square = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    red, green, blue = kinds(raw.shape, pattern)
    found = [smooth(raw * m, k) for m, k in ((red, square), (green, cross), (blue, square))]
    return np.stack(found, axis=-1)


def malvar(raw, pattern):
    """Follow the filters of Malvar, He and Cutler 2004, figure 2."""
    green = np.array(
        [[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]
    )
    row = np.array(
        [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0],
         [0, 0, 0.5, 0, 0]]
    )  # fmt: skip
    cross = np.array(
        [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0],
         [0, 0, -1.5, 0, 0]]
    )  # fmt: skip
    masks = kinds(raw.shape, pattern)
    by_row, by_column, by_cross = (smooth(raw, k / 8) for k in (row, row.T, cross))
    found = np.stack([raw] * 3, axis=-1).astype(float)
    found[..., 1] = np.where(masks[1], raw, smooth(raw, green / 8))
    for channel, own, other in ((0, masks[0], masks[2]), (2, masks[2], masks[0])):
        in_row = own.any(axis=1)[:, None] & masks[1]
        found[..., channel] = np.where(
            own, raw, np.where(other, by_cross, np.where(in_row, by_row, by_column))
        )
    return found


def menon(raw, pattern):
    """Follow Menon, Andriani and Calvagno 2007, with the refining step."""
    raw = raw.astype(float)
    red, is_green, blue = kinds(raw.shape, pattern)
    taps, pair, third = [-0.25, 0.5, 0.5, 0.5, -0.25], [0.5, 0, 0.5], np.full(3, 1 / 3)
    greens = [np.where(is_green, raw, along(raw, taps, axis)) for axis in (1, 0)]
    changes = []
    for axis, g in zip((1, 0), greens, strict=True):
        difference = raw - g
        n = raw.shape[axis]
        ahead = np.take(difference, [i if i < n else 2 * n - 2 - i for i in range(2, n + 2)], axis)
        weights = np.zeros((5, 5))
        weights[::2, [0, 2]] = [[1, 1], [3, 3], [1, 1]]
        weights[1::2, 1] = 1
        k = weights if axis == 1 else weights.T
        changes.append(convolve(np.abs(difference - ahead), k[::-1, ::-1], mode="constant"))
    level = changes[1] >= changes[0]
    green = np.where(level, greens[0], greens[1])
    colours = {}
    for own in (red, blue):
        rows = own.any(axis=1)[:, None]
        by = [raw + along(raw, pair, axis) - along(green, pair, axis) for axis in (1, 0)]
        colours[id(own)] = np.where(own, raw, np.where(rows, by[0], by[1]))
    first, last = colours[id(red)], colours[id(blue)]

    def across(a, b):
        by = [a + along(b, pair, axis) - along(a, pair, axis) for axis in (1, 0)]
        return np.where(level, *by)

    first, last = (
        np.where(blue, across(last, first), first),
        np.where(red, across(first, last), last),
    )

    def mean(difference):
        return np.where(level, along(difference, third, 1), along(difference, third, 0))

    green = np.where(red, first - mean(first - green), green)
    green = np.where(blue, last - mean(last - green), green)
    for own, values in ((red, first), (blue, last)):
        by = [green + along(values - green, pair, axis) for axis in (1, 0)]
        values[is_green] = np.where(own.any(axis=1)[:, None], *by)[is_green]
    smooth_red, smooth_blue = mean(first - last), mean(last - first)
    first, last = (
        np.where(blue, last + smooth_red, first),
        np.where(red, first + smooth_blue, last),
    )
    return np.stack([first, green, last], axis=-1)


def _windowed(p, q, u, v, windows, prior):
    """Return the weights of lines, and these times slope and intercept."""
    mp, mq, uv, vv, uu, pp, pq, qq = (
        windows(m) for m in (p, q, u * v, v * v, u * u, p * p, p * q, q * q)
    )
    least = (mp**2 + mq**2) * 0.5 / 128**2 + 1e-30
    extra = prior * np.maximum(uu - uv**2 / (vv + least), 0) + least
    a = (uv + extra) / (vv + extra)
    b = mp - a * mq
    off = pp - mp**2 - 2 * a * (pq - mp * mq) + a**2 * (qq - mq**2)
    w = 1 / (np.maximum(off, 0) + least)
    return w, w * a, w * b


def _between(rest, green, step, ring):
    """Return the mean of two pairs of neighbours, which weigh as they change little."""
    (dy, dx), pairs = step, []
    for v, u in ((dy, dx), (dx, -dy)):
        before, after = np.roll(rest, (v, u), (0, 1)), np.roll(rest, (-v, -u), (0, 1))
        change = smooth(np.abs(before - after), ring / 6)
        pairs.append(((before + after) / 2, 1 / (change**4 + (0.08 * green) ** 4 + 1e-30)))
    return sum(m * w for m, w in pairs) / sum(w for _, w in pairs)


def residual(raw, pattern):
    """State the method as the page of the family does, with sums over whole planes."""
    border = 44
    raw = np.pad(raw.astype(float), border, mode="reflect")
    red, is_green, blue = kinds(raw.shape, pattern)
    even, odd = np.arange(13) % 2 == 0, np.arange(13) % 2 == 1
    total = weights = 0.0
    for axis in (1, 0):
        p, q = raw, along(raw, [0.5, 0, 0.5], axis)
        u, v = (m - along(m, even / 7, axis) for m in (p, q))
        lines = [
            _windowed(p, q, u, v, lambda m, k=k, axis=axis: along(m, k / k.sum(), axis), 1)
            for k in (even, odd)
        ]

        def line(x, here, beside, axis=axis):
            w, a, b = (
                along(h, 1.0 * even, axis) + along(n, 1.0 * odd, axis)
                for h, n in zip(here, beside, strict=True)
            )
            return (a * x + b) / w

        one, other = lines
        rest = p - line(q, one, other)
        found = line(p, other, one) + along(rest, [0.5, 0, 0.5], axis)
        d = np.where(is_green, p - found, found - p)
        square = np.ones((5, 5))
        texture = smooth(along(raw, [-0.25, 0, 0.5, 0, -0.25], axis) ** 2, square)
        slope = smooth(along(d, np.array([-1, -2, -1, 0, 1, 2, 1]) / 8, axis) ** 2, square)
        change = smooth(np.abs(along(d, [-1, 0, 1], axis)), square / 25)
        mean = along(d, np.array([1, 2, 3, 4, 3, 2, 1]) / 16, axis)
        found = mean + (d - mean) * slope**2 / (slope**2 + 0.2 * texture**2 + 1e-30)
        w = 1 / (change**2 + 1e-6 * raw**2 + 1e-30)
        total, weights = total + w * found, weights + w
    green = np.where(is_green, raw, raw + total / weights)
    colours = []
    for own in (red, blue):
        rows, columns = own.any(axis=1)[:, None], own.any(axis=0)[None, :]
        count = np.where(rows, 3, 4) * np.where(columns, 3, 4)

        def window(m, own=own, count=count):
            seven = np.ones((7, 7))
            return smooth(m * own, seven) / count

        centred = [own * (m - smooth(m * own, np.ones((5, 5))) / 9) for m in (raw, green)]
        w, a, b = _windowed(raw, green, centred[0], centred[1], window, 0.3)
        tentative = (smooth(a, np.ones((7, 7))) * green + smooth(b, np.ones((7, 7)))) / smooth(
            w, np.ones((7, 7))
        )
        rest = np.where(own, raw - tentative, 0)
        diagonal = ~rows & ~columns
        ring = np.zeros((5, 5))
        ring[[0, 2, 2, 4, 2], [2, 0, 4, 2, 2]] = 1, 1, 1, 1, 2
        rest = np.where(diagonal, _between(rest, green, (1, 1), ring), rest)
        ring = np.array([[1, 0, 1], [0, 2, 0], [1, 0, 1]])
        rest = np.where(own | diagonal, rest, _between(rest, green, (0, 1), ring))
        colours.append(tentative + rest)
    found = np.stack([colours[0], green, colours[1]], axis=-1)
    return found[border:-border, border:-border]
