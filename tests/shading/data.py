"""Images of known surfaces, which are not ours to ship."""

import json

import imageio.v3 as iio
import numpy as np

from tests.truth import truth


def ball():
    """Return images, lights, mask and normals of a real glossy ball."""
    folder = truth("light_colour") / "photometric_stereo" / "diligent_ball"
    strengths = np.loadtxt(folder / "light_intensities.txt")
    files = sorted(folder.glob("0*.png"))
    images = [(iio.imread(f) / s).mean(axis=-1) for f, s in zip(files, strengths, strict=True)]
    mask = iio.imread(folder / "mask.png")
    assert "z to" in json.loads((folder / "meta.json").read_text())["normals"]
    normals = next(iter(np.load(folder / "normal_gt.npz").values()))
    lights = np.loadtxt(folder / "light_directions.txt")
    return np.stack(images), lights, mask.reshape(*mask.shape[:2], -1)[..., 0] > 0, normals


def bunny():
    """Return the same of a rendered matt rabbit, with shadows."""
    folder = truth("light_colour") / "photometric_stereo" / "bunny_lambert"
    found = np.load(folder / "data.npz")
    return found["images"], found["lights"], found["mask"] > 0, found["normal_gt"]


def sphere(name):
    """Return images and mask of a real sphere, "gray" or "chrome"."""
    folder = truth("light_colour") / "photometric_stereo" / "uw_psm" / name
    images = [iio.imread(folder / f"{name}.{k}.png").astype(np.float32) for k in range(12)]
    mask = iio.imread(folder / f"{name}.mask.png")
    images = np.stack([i.mean(axis=-1) if i.ndim == 3 else i for i in images])
    return images, mask.reshape(*mask.shape[:2], -1)[..., 0] > 128


def round_normals(mask):
    """Return the normals of a sphere that fills a mask."""
    rows, columns = np.nonzero(mask)
    radius = np.sqrt(len(rows) / np.pi)
    y, x = np.indices(mask.shape)
    n = np.stack([(x - columns.mean()) / radius, (rows.mean() - y) / radius], axis=-1)
    z = np.sqrt(np.maximum(1 - (n**2).sum(axis=-1), 0))
    return np.concatenate([n, z[..., None]], axis=-1)


def apart(found, right, mask):
    """Return the mean angle in degrees between normals; none counts 90."""
    a, b = np.asarray(found, float)[mask], np.asarray(right, float)[mask]
    cosines = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return np.nan_to_num(np.degrees(np.arccos(np.clip(cosines, -1, 1))), nan=90.0).mean()
