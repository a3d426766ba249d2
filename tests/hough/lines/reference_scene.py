"""A picture of straight edges whose positions are known, rendered by exact areas of pixels."""

import numpy as np

SHAPE = (260, 340)
BACKGROUND, QUADRILATERAL, STRIPE, BAR = 60.0, 90.0, 80.0, 250.0
APART = 4.0  # pixels between the four parallel edges of two stripes
CLEAR = 9.0  # pixels: smallest distance of a speck from an edge or another speck


def half_plane(normal, distance, y, x):
    """Return the share of each pixel's area where ``normal . (y, x) >= distance``.

    A pixel's area beyond a line at distance d is a trapezoid, integrated: second differences of
    ``max(d, 0)^2 / 2`` at the widths of the pixel's two sides, as seen along the normal.
    """
    wide, narrow = np.sort(np.abs(normal))[::-1]
    narrow = max(narrow, 1e-4)
    d = normal[0] * y + normal[1] * x - distance

    def ramp(t):
        return np.maximum(t, 0) ** 2 / 2

    outer, inner = (wide + narrow) / 2, (wide - narrow) / 2
    return (ramp(d + outer) - ramp(d + inner) - ramp(d - inner) + ramp(d - outer)) / (wide * narrow)


def convex(corners, y, x):
    """Return the share of each pixel inside a convex polygon; exact where one side crosses it."""
    share = np.ones(y.shape)
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        down, along = (end - begin) / np.hypot(*(end - begin))
        normal = np.array([along, -down])
        normal *= np.sign(normal @ (corners.mean(axis=0) - begin))
        share *= half_plane(normal, normal @ begin, y, x)
    return share


def rectangle(centre, angle, length, width):
    """Return the corners of a rectangle whose long side is `angle` from columns to rows."""
    along = np.array([np.sin(angle), np.cos(angle)]) * length / 2
    across = np.array([np.cos(angle), -np.sin(angle)]) * width / 2
    return centre + np.array([-along - across, along - across, along + across, -along + across])


def sides(corners):
    """Return the sides of a polygon, (N, 4)."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def away(point, segment):
    """Return the distance of a point from a segment."""
    begin, step = segment[:2], segment[2:] - segment[:2]
    t = ((point - begin) @ step / (step @ step)).clip(0, 1)
    return np.hypot(*(point - begin - t * step))


def scene(noise, seed=0):
    """Return a uint8 picture, and its straight edges as (row, column, row, column).

    It has a quadrilateral, two stripes with parallel edges that are 4 pixels apart, a bar that
    crosses them and cuts each edge in two, and 60 small specks.
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    corners = np.array([[20, 25], [30, 150], [125, 170], [110, 40]], float)
    bar = rectangle(np.array([178.0, 190]), 1.45, 140, 16)
    picture = BACKGROUND + QUADRILATERAL * convex(corners, y, x)
    edges = [*sides(corners), *sides(bar)]
    middle, angle, half = np.array([180.0, 175]), 0.31, 130
    along = np.array([np.sin(angle), np.cos(angle)])
    across = np.array([np.cos(angle), -np.sin(angle)])
    for k in (-1, 1):
        stripe = rectangle(middle + k * APART * across, angle, 2 * half, APART)
        picture += STRIPE * convex(stripe, y, x)
    for k in (-1.5, -0.5, 0.5, 1.5):
        begin, end = (middle + k * APART * across + s * half * along for s in (-1, 1))
        cuts = [
            np.linalg.solve(np.stack([along, p - q], axis=1), p - begin)[0] * along + begin
            for p, q in ((bar[0], bar[1]), (bar[3], bar[2]))
        ]
        first, second = sorted(cuts, key=lambda cut: float(cut @ along))
        edges += [np.append(begin, first), np.append(second, end)]
    share = convex(bar, y, x)
    picture = picture * (1 - share) + BAR * share
    specks = []
    while len(specks) < 60:
        speck = rng.uniform((6, 6), np.array(SHAPE) - 6)
        near = [away(speck, e) for e in edges] + [np.hypot(*(speck - s)) for s in specks]
        if min(near) > CLEAR:
            specks.append(speck)
            disc = (rng.uniform(1.2, 2.5) - np.hypot(y - speck[0], x - speck[1]) + 0.5).clip(0, 1)
            picture += rng.uniform(-40, 60) * disc
    picture += rng.normal(0, noise, SHAPE)
    return picture.clip(0, 255).astype(np.uint8), np.array(edges)
