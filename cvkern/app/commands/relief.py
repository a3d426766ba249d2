"""``cvkern relief``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import cvkern
from cvkern.app.commands import (
    PHOTOGRAPHS,
    Backend,
    Device,
    Folder,
    OverwriteFolder,
    as_gray,
    check_folder,
)

RESULTS = ("normals.png", "albedo.png", "depth.tif", "mesh.ply", "relit.gif")
LIGHTS = ("lights.txt", "light_directions.txt")
STRENGTHS = "light_intensities.txt"
FRAMES = 36  # pictures of one turn of the light
SLANT = 0.8  # tangent of the angle between the light of the film and the view
BRIGHT = 99.0  # percentile of albedo that is shown as white


def relief(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of images.")],
    output: Folder,
    lights: Annotated[
        Path | None, typer.Option(help="Text file with a line of x y z for each image.")
    ] = None,
    sphere: Annotated[
        Path | None, typer.Option(help="Folder of images of a chrome sphere, and its mask.")
    ] = None,
    mask: Annotated[Path | None, typer.Option(help="Image that is black outside the body.")] = None,
    method: Annotated[
        str,
        typer.Option(help="consensus, least_squares, trimmed, l1 or sparse_bayes."),
    ] = "consensus",
    integration: Annotated[str, typer.Option(help="poisson or bilateral.")] = "poisson",
    overwrite: OverwriteFolder = False,
    backend: Backend = None,
    device: Device = None,
) -> None:
    """Find the relief of a body from images of it under several lights.

    The images of FOLDER are read in the order of their names, and must be linear in light. An image
    with "mask" in its name is the body's mask. Lights come from --lights, from a chrome sphere
    under the same lights, from lights.txt or light_directions.txt in FOLDER, or else from the
    images themselves. Lights are x to the right, y up and z towards the camera. If there is a
    light_intensities.txt beside their file, with one number or red, green and blue for each light,
    their lengths are multiplied by it. DIR gets
    normals.png (x, y and z as red, green and blue), albedo.png, depth.tif (pixels, growing away
    from the camera), mesh.ply, and relit.gif, a film of the body under a moving light.
    """
    check_folder(output, RESULTS, overwrite)
    if lights and sphere:
        raise ValueError(f"lights must be given without sphere, got {str(lights)!r} and a sphere")
    images, inside = read_folder(folder, mask)
    if inside is None:
        inside = np.ones(images.shape[1:], bool)
    with cvkern.use(backend=backend, device=device):
        vectors, said = _lights(folder, lights, sphere, images, inside)
        found = cvkern.photometric_stereo(images, vectors, method=method, mask=inside)
        if not np.isfinite(found.normals).any():
            raise ValueError("images must determine at least one normal, got too dark or too few")
        depth = cvkern.integrate_normals(found.normals, inside, method=integration)
        files = _results(found, depth)
    output.mkdir(parents=True, exist_ok=True)
    typer.echo(f"{len(images)} images of {images.shape[1]} x {images.shape[2]}, lights {said}")
    for name, (write, what) in files.items():
        write(output / name)
        typer.echo(f"{output / name}: {what}")


def read_folder(folder: Path, mask: Path | None = None) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the images of a folder, (K, H, W) with values up to 1, and its mask or None."""
    from cvkern.images.files import read_image

    if not folder.is_dir():
        raise ValueError(f"folder must be a folder of images, got {str(folder)!r}")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in PHOTOGRAPHS)
    masks = [f for f in files if "mask" in f.stem.lower()]
    files = sorted((f for f in files if f not in masks and f != mask), key=_order)
    if not files:
        raise ValueError(f"folder must have images, got none in {str(folder)!r}")
    images = []
    for file in files:
        image = read_image(file)
        white = float(np.iinfo(image.dtype).max) if image.dtype.kind in "iu" else 1.0
        values = as_gray(image.astype(np.float32)) / np.float32(white)
        if images and values.shape != images[0].shape:
            raise ValueError(f"images must have one size, got another in {str(file)!r}")
        images.append(values)
    chosen = mask or (masks[0] if masks else None)
    if chosen is None:
        return np.stack(images), None
    inside = as_gray(read_image(chosen)) > 0
    if inside.shape != images[0].shape:
        raise ValueError(f"mask must have the size of the images, got another in {str(chosen)!r}")
    return np.stack(images), inside


def _order(file: Path) -> tuple[str, int, str]:
    """Return a key by which a.2.png comes before a.10.png."""
    digits = "".join(c for c in file.stem if c.isdigit())
    return file.stem.rstrip("0123456789"), int(digits or 0), file.name


def _lights(
    folder: Path,
    lights: Path | None,
    sphere: Path | None,
    images: np.ndarray,
    inside: np.ndarray,
) -> tuple[np.ndarray, str]:
    """Return the lights of the images, and words that say where they come from."""
    if sphere:
        shining, ball = read_folder(sphere)
        if ball is None:
            raise ValueError(f"sphere must have a mask in its folder, got none in {str(sphere)!r}")
        if len(shining) != len(images):
            raise ValueError(f"sphere must have {len(images)} images, got {len(shining)}")
        return cvkern.lights_from_sphere(shining, ball), "of the sphere"
    beside = [folder / name for name in LIGHTS if (folder / name).exists()]
    chosen = lights or (beside[0] if beside else None)
    if chosen is None:
        return cvkern.estimate_lights(images, mask=inside), "of the images themselves"
    vectors, said = _table(chosen, "x y z"), f"of {chosen}"
    strengths = chosen.with_name(STRENGTHS)
    if strengths == chosen or not strengths.exists():
        return vectors, said
    powers = _table(strengths, "one number, or red green blue")
    if len(powers) != len(vectors) or powers.shape[1] not in (1, 3):
        raise ValueError(
            f"{STRENGTHS} must have {len(vectors)} lines of 1 or 3 numbers, got {powers.shape}"
        )
    if powers.shape[1] == 3:
        powers = as_gray(powers[None])[0, :, None]  # weights of colours as in the images
    return vectors * powers, f"{said} and {STRENGTHS}"


def _table(file: Path, what: str) -> np.ndarray:
    """Return the numbers of a text file, a row for each line."""
    try:
        return np.loadtxt(file, delimiter="," if "," in file.read_text() else None, ndmin=2)
    except ValueError as error:
        raise ValueError(f"lights must be lines of {what}, got {str(file)!r}: {error}") from None


def _results(
    found: cvkern.PhotometricStereo, depth: np.ndarray
) -> dict[str, tuple[Callable[[Path], None], str]]:
    """Return, for each file name, a function that writes the file, and a summary of it."""
    from cvkern.clouds import write_animation
    from cvkern.images.files import write_image
    from cvkern.radiance.surfaces import Mesh, write_mesh

    there = np.isfinite(depth)
    shown = np.where(there[..., None], found.normals, -1) * 0.5 + 0.5
    colors = (255 * shown.clip(0, 1)).round().astype(np.uint8)
    white = max(float(np.percentile(found.albedo[there], BRIGHT)), 1e-12)
    albedo = np.where(there, found.albedo / white, 0).clip(0, 1)
    gray = (255 * albedo).round().astype(np.uint8)
    mesh = cvkern.mesh_from_depth(depth)
    tints = np.repeat(gray[there][:, None], 3, axis=1)
    movie = relit(found.normals, albedo)
    near, far = depth[there].min(), depth[there].max()
    return {
        "normals.png": (lambda path: write_image(path, colors), f"{there.sum()} pixels"),
        "albedo.png": (lambda path: write_image(path, gray), f"white is {white:.6g}"),
        "depth.tif": (lambda path: write_image(path, depth), f"{near:.6g} to {far:.6g} pixels"),
        "mesh.ply": (
            lambda path: write_mesh(path, Mesh(mesh.vertices, mesh.faces, tints)),
            f"{len(mesh.faces)} triangles",
        ),
        "relit.gif": (lambda path: write_animation(path, movie), f"{len(movie)} frames"),
    }


def relit(normals: np.ndarray, albedo: np.ndarray, frames: int = FRAMES) -> np.ndarray:
    """Return frames of a body under a light that circles the view axis, uint8 (F, H, W, 3)."""
    turns = 2 * np.pi * np.arange(frames) / frames
    lamps = np.stack([SLANT * np.cos(turns), SLANT * np.sin(turns), np.ones(frames)], axis=1)
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    images = cvkern.lambertian(normals, lamps, albedo=albedo)
    seen = (255 * images.clip(0, 1) ** (1 / 2.2)).round().astype(np.uint8)
    return np.repeat(seen[..., None], 3, axis=3)
