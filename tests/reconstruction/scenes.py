"""Cameras around points, with exact truth, and what they see."""

from typing import NamedTuple

import numpy as np
import scipy.ndimage as ndi

import cvkern

SIDES = 480, 640
FOCAL = 600.0


class Scene(NamedTuple):
    """Cameras, points and sightings."""

    poses: np.ndarray
    points: np.ndarray
    tracks: np.ndarray
    places: np.ndarray
    camera: cvkern.Camera


def camera(focal=FOCAL, bent=()):
    height, width = SIDES
    middle = (width - 1) / 2, (height - 1) / 2
    matrix = [[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]]
    return cvkern.Camera(matrix, bent, SIDES)


def ring(count, spread=1.2, distance=4.0, seed=0):
    """Return poses of cameras on an arc, which look at the origin."""
    rng = np.random.default_rng(seed)
    poses = []
    for angle in np.linspace(-spread / 2, spread / 2, count):
        away = distance * rng.uniform(0.9, 1.1)
        eye = away * np.array([np.sin(angle), rng.uniform(-0.15, 0.15), -np.cos(angle)])
        ahead = -eye / np.linalg.norm(eye)
        right = np.cross([0, 1, 0], ahead)
        right /= np.linalg.norm(right)
        poses.append(np.column_stack((right, np.cross(ahead, right), ahead, eye)))
    return np.stack(poses)


def project(poses, points, lens):
    """Return (row, column) of all points in all views, (N, P, 2)."""
    seen = []
    for pose in poses:
        turn = pose[:, :3].T
        seen.append(cvkern.project_points(points, lens, turn, -turn @ pose[:, 3]))
    return np.stack(seen)


def make(count=6, points=80, noise=0.0, outliers=0.0, bent=(), seed=0):
    """Return a scene in which each camera sees most points."""
    rng = np.random.default_rng(seed)
    poses, lens = ring(count), camera(bent=bent)
    cloud = rng.uniform(-1, 1, (points, 3))
    seen = project(poses, cloud, lens)
    there = rng.random((points, count)) < 0.8
    there[:, 0] |= there.sum(axis=1) < 2
    there[:, 1] |= there.sum(axis=1) < 2
    tracks = np.argwhere(there)
    places = seen[tracks[:, 1], tracks[:, 0]] + rng.normal(0, 1, (len(tracks), 2)) * noise
    wrong = rng.random(len(tracks)) < outliers
    places[wrong] += rng.uniform(-60, 60, (int(wrong.sum()), 2))
    return Scene(poses, cloud, tracks, places, lens)


def aligned(found, true):
    """Return centres (N, 3) after the similarity [Umeyama 1991] that fits the true ones best, and
    its rotation.
    """
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = (u * sign) @ vt
    scale = (s * sign).sum() / (a * a).sum()
    return scale * a @ turn.T + true.mean(axis=0), turn


def errors(found, true):
    """Return the largest errors: of centres, as a share of their extent; of turns, degrees."""
    there, turn = aligned(found[:, :, 3], true[:, :, 3])
    extent = np.linalg.norm(true[:, :, 3] - true[:, :, 3].mean(axis=0), axis=1).max()
    off = np.linalg.norm(there - true[:, :, 3], axis=1).max() / extent
    between = (turn @ found[:, :, :3]).transpose(0, 2, 1) @ true[:, :, :3]
    # The length of R - I is sqrt(8) times the sine of half the angle.
    half = np.linalg.norm(between - np.eye(3), axis=(1, 2)) / np.sqrt(8)
    return off, np.degrees(2 * np.arcsin(np.minimum(half, 1))).max()


# Rectangles: a corner, two sides, and how many pixels their textures have a unit of length.
BOARDS = (
    ((-3.0, -3.0, 1.5), (6.0, 0.0, 0.0), (0.0, 6.0, 0.0)),
    ((-1.2, -0.9, 0.2), (1.1, 0.0, -0.7), (0.0, 1.6, 0.0)),
    ((0.2, -0.6, -0.6), (0.8, 0.0, 0.5), (0.0, 1.3, 0.3)),
)
FINE = 40


def photographs(poses, lens, seed=0):
    """Render grey photographs (N, H, W) of textured boards, the nearest of each ray."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(lens.shape)
    fx, fy, cx, cy = lens.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    rays = np.stack(((x - cx) / fx, (y - cy) / fy, np.ones(x.shape)), axis=2)
    textures = []
    for _, u, v in BOARDS:
        sides = [int(FINE * np.linalg.norm(s)) for s in (v, u)]
        noise = rng.normal(size=(sides[0], sides[1]))
        grey = sum(s * ndi.gaussian_filter(noise, s, mode="wrap") for s in (0.8, 2.0, 5.0))
        textures.append(np.clip(128 + 60 * grey / np.std(grey), 0, 255))
    made = []
    for pose in poses:
        ahead, eye = rays @ pose[:, :3].T, pose[:, 3]
        nearest, seen = np.full(lens.shape, np.inf), np.zeros(lens.shape)
        for (corner, u, v), texture in zip(BOARDS, textures, strict=True):
            u, v, start = np.array(u), np.array(v), np.array(corner) - eye
            normal = np.cross(u, v)
            away = (start @ normal) / (ahead @ normal)
            at = ahead * away[..., None] - start
            # The sides of a board may be slanted: solve for both shares together.
            square = np.array([[u @ u, u @ v], [u @ v, v @ v]])
            across, down = np.einsum(
                "ij,jhw->ihw", np.linalg.inv(square), np.stack((at @ u, at @ v))
            )
            inside = (away > 0) & (away < nearest) & (across >= 0) & (across <= 1)
            inside &= (down >= 0) & (down <= 1)
            place = np.stack((down * (texture.shape[0] - 1), across * (texture.shape[1] - 1)))
            seen[inside] = ndi.map_coordinates(texture, place[:, inside], order=1)
            nearest[inside] = away[inside]
        made.append(np.round(seen).astype(np.uint8))
    return np.stack(made)
