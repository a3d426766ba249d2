"""Points of tracks against all pairs of their rays, and the pull of a lens, without kernels."""

from itertools import combinations

import numpy as np

from cvkern.reconstruction import _adjustment, _triangulation


def rays_of(tracks, eyes_and_ends):
    eyes, ends = eyes_and_ends
    ahead = ends - eyes
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    return _triangulation.Rays(tracks, eyes, ahead, np.arange(len(tracks)))


def middle(a, u, b, v):
    """Return the point in the middle between two rays, by least squares."""
    s, t = np.linalg.lstsq(np.stack((u, -v), axis=1), b - a, rcond=None)[0]
    return (a + s * u + b + t * v) / 2


def test_the_pair_of_rays_that_most_others_fit_wins():
    """Of pairs that equally many fit, the one with the least sum of distances."""
    rng = np.random.default_rng(3)
    sizes = np.array([2, 3, 4, 5, 4, 5, 4, 5])
    tracks = np.repeat(2 * np.arange(len(sizes)), sizes)
    points = rng.uniform((-1, -1, 5), (1, 1, 7), (len(sizes), 3))
    ends = np.repeat(points, sizes, axis=0) + rng.normal(0, 0.004, (len(tracks), 3))
    ends[np.cumsum(sizes)[4:] - 1] += 0.5  # the last of some tracks is wrong
    rays = rays_of(tracks, (rng.uniform(-2, 2, (len(tracks), 3)), ends))

    def errors(at):
        return 500 * np.linalg.norm(np.cross(at - rays.eyes, rays.ahead), axis=1)

    found = _triangulation.triangulate(rays, 0.02, 5.0, errors, 0)
    np.testing.assert_array_equal(found.tracks, 2 * np.arange(len(sizes)))
    for name, point in zip(found.tracks, found.points, strict=True):
        own = np.flatnonzero(tracks == name)
        best, want = (0, 0.0), np.zeros(3)
        for i, j in combinations(own, 2):
            tried = middle(rays.eyes[i], rays.ahead[i], rays.eyes[j], rays.ahead[j])
            off = errors(np.tile(tried, (len(tracks), 1)))
            near = off[own] <= 5.0
            if off[i] <= 5 and off[j] <= 5 and (near.sum(), -off[own][near].sum()) > best:
                best, want = (near.sum(), -off[own][near].sum()), tried
        np.testing.assert_allclose(point, want, atol=1e-9)


def test_the_widest_angle_need_not_have_the_first_ray():
    angles = np.radians([0, 12, -9, 4, 3, 8, 7])
    ahead = np.stack((np.sin(angles), np.zeros(7), np.cos(angles)), axis=1)
    rays = rays_of(np.array([0, 0, 0, 0, 2, 2, 3]), (np.zeros((7, 3)), ahead))
    found = _triangulation.widest_angles(rays, 5)
    np.testing.assert_allclose(found, np.radians([21, 0, 5, 0, 0]), atol=1e-12)


def test_the_pull_of_a_lens_to_its_anchor():
    """A lens as far from it as the spreads say costs ALIKE times the noise squared, halved."""
    anchor = np.array([[500.0, 510, 319.5, 239.5, 0, 0, 0, 0, 0]])
    lenses = anchor + np.array([7, 7, 0.015 * 640, 0, 0.05, 0, 0, 0, 0])
    none = np.empty(0)
    bundle = _adjustment.Bundle(none, none, lenses, none, none, none, none)
    effort = _adjustment.Effort(size=11, anchor=anchor, noise=0.6)
    pull, stiffness = _adjustment._anchored(bundle, effort)
    costs = pull**2 / np.where(stiffness > 0, stiffness, 1)
    np.testing.assert_allclose(costs, [[0, 30 * 0.36, 0, 30 * 0.36, 0]])
