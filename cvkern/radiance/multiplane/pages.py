"""Multiplane images as files for other programs: an atlas of the planes, and a page that moves."""

from __future__ import annotations

import base64
import json
import math
import os
from typing import Any

import numpy as np

from cvkern._checks import check_instance, check_integer, check_number
from cvkern._files import as_path, check_target, write_text
from cvkern.radiance.fields.blended import BlendedStacks
from cvkern.radiance.fields.planes import PlaneStack, Reference
from cvkern.radiance.models import Model

__all__ = ["write_planes"]

MOST_SIDE = 2**14  # pixels of an atlas, which most GPUs draw


def write_planes(
    model: Model,
    path: str | os.PathLike[str],
    *,
    reference: int = 0,
    motion: float = 0.025,
    background: Any = None,
) -> None:
    """Write the planes of a model as a page for a browser, or as an atlas.

    Parameters
    ----------
    model : Model
        A model of a :class:`PlanesField`, as :func:`fit`, :func:`planes_from_depth` and
        :func:`planes_from_stereo` return.
    path : path
        Ends in ``.html`` for one file that a browser opens without a server and without a
        network; the view follows the mouse, or a finger, and the wheel moves it forward. Or ends in
        ``.png`` for the atlas, beside which a ``.json`` of the same name says where the planes are.
    reference : int, default 0
        Which of several reference cameras has the planes to write. Pages and atlases do not blend.
    motion : float, default 0.025
        How far the nearest or the farthest plane of a page moves to each side, as a share of the
        picture's longer side, from 0 to 1.
    background : (red, green, blue), optional
        In [0, 1]: the colour behind the planes of a page; by default ``model.behind``.

    Raises
    ------
    FileNotFoundError
        If the folder of `path` does not exist.
    TypeError
        If an argument has the wrong type.
    ValueError
        If the model has no planes, `path` has another ending, an option is out of its range, or
        the atlas would have sides of more than 16384 pixels.

    Notes
    -----
    The atlas has 8 bits a channel, with straight opacity, as PNG asks for. Its planes are in raster
    order, the nearest first, in ``columns`` columns. The page needs WebGL. With a place in its
    address, ``page.html#0.5,-1``, it stays there: right and down, from -1 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from cvkern.radiance import planes_from_depth, write_planes
    >>> image, K = np.full((8, 9, 3), 128, np.uint8), [[9, 0, 4], [0, 9, 3.5], [0, 0, 1]]
    >>> model = planes_from_depth(image, np.full((8, 9), 2.0), K, planes=2)
    >>> write_planes(model, "planes.html")
    """
    from cvkern.images.files import write_image
    from cvkern.radiance.rendering import check_behind

    check_instance(model, Model, "model")
    motion = check_number(motion, "motion", low=0.0)
    if motion > 1:
        raise ValueError(f"motion must lie in [0, 1], got {motion:g}")
    behind = model.behind if background is None else check_behind(background)
    target = as_path(path)
    if target.suffix.lower() not in (".html", ".png"):
        raise ValueError(f"path must end in .html or .png, got {str(path)!r}")
    check_target(target)
    field = model.field
    stacks = field.stacks if isinstance(field, BlendedStacks) else [field]
    field = stacks[check_integer(reference, "reference", 0, len(stacks) - 1)]
    if not isinstance(field, PlaneStack):
        raise ValueError(f"model must be of a PlanesField, got {type(model.settings).__name__}")
    model.rt  # noqa: B018  (this thread may not have used the device yet)
    texels = field.bytes()
    atlas, columns = _atlas(texels)
    facts = _facts(field.reference, model.frame.bounds.half, texels.shape, columns)
    if target.suffix.lower() == ".png":
        write_image(target, atlas)
        write_text(target.with_suffix(".json"), json.dumps(facts, indent=1))
        return
    import imageio.v3 as iio

    picture = iio.imwrite("<bytes>", atlas, extension=".png")
    colors = ", ".join(f"{float(c):.4f}" for c in behind)
    page = PAGE.replace("FACTS", json.dumps(facts | {"motion": motion})).replace("BEHIND", colors)
    page = page.replace("ATLAS", base64.b64encode(picture).decode())
    write_text(target, page)


def _atlas(texels: np.ndarray) -> tuple[np.ndarray, int]:
    """Return all planes as one picture with straight opacity, and its columns of planes."""
    count, height, width, _ = texels.shape
    columns = max(1, min(count, round(math.sqrt(count * height / width))))
    rows = -(-count // columns)
    if max(rows * height, columns * width) > MOST_SIDE:
        raise ValueError(
            f"model must have an atlas of at most {MOST_SIDE} pixels a side, got "
            f"{rows * height} x {columns * width}: fit with less detail or fewer planes"
        )
    atlas = np.zeros((rows, height, columns, width, 4), np.uint8)
    for k, plane in enumerate(texels):
        opacity = plane[..., 3:].astype(np.float32)
        color = plane[..., :3] * (255 / np.maximum(opacity, 1))
        cell = atlas[k // columns, :, k % columns]
        cell[..., :3] = np.rint(color.clip(0, 255))
        cell[..., 3:] = plane[..., 3:]
    return atlas.reshape(rows * height, columns * width, 4), columns


def _facts(
    reference: Reference, half: float, shape: tuple[int, ...], columns: int
) -> dict[str, Any]:
    """Return the sizes and places of the planes for programs, in units of the world."""
    count, height, width, _ = shape
    return {
        "planes": count,
        "height": height,
        "width": width,
        "columns": columns,
        "lens": [round(float(n), 4) for n in reference.lens],
        "depths": [float(f"{half / q:.7g}") for q in reference.disparities],
    }


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Multiplane image</title>
<style>
html, body { margin: 0; height: 100%; background: #111; overflow: hidden; }
canvas { position: absolute; inset: 0; margin: auto; max-width: 100%; max-height: 100%;
  touch-action: none; }
p { color: #eee; font: 16px sans-serif; text-align: center; }
</style>
</head>
<body>
<canvas></canvas>
<script>
"use strict";
const facts = FACTS;
const behind = [BEHIND];
const {planes, height, width, columns, lens, depths, motion} = facts;
const canvas = document.querySelector("canvas");
canvas.width = width;
canvas.height = height;
const gl = canvas.getContext("webgl", {alpha: false, preserveDrawingBuffer: true});
if (!gl) {
  document.body.innerHTML = "<p>This page needs WebGL.</p>";
  throw new Error("no WebGL");
}
// A camera that moves by e sees a plane of inverse depth q shifted by -f e q, and a camera that
// moves forward by z sees it larger by 1 / (1 - z q). The plane in the middle stays where it is.
const vertex = `
attribute vec2 corner;
uniform vec2 size, center, shift;
uniform float scale;
varying vec2 texel;
void main() {
  texel = corner * size;
  vec2 at = (texel - center) * scale + center + shift;
  gl_Position = vec4(2.0 * at.x / size.x - 1.0, 1.0 - 2.0 * at.y / size.y, 0.0, 1.0);
}`;
const fragment = `
precision highp float;
uniform sampler2D atlas;
uniform vec2 size, cell, whole;
varying vec2 texel;
void main() {
  gl_FragColor = texture2D(atlas, (cell + clamp(texel, vec2(0.5), size - 0.5)) / whole);
}`;
function compiled(kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  return shader;
}
const program = gl.createProgram();
gl.attachShader(program, compiled(gl.VERTEX_SHADER, vertex));
gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, fragment));
gl.linkProgram(program);
gl.useProgram(program);
const at = name => gl.getUniformLocation(program, name);
gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
const corner = gl.getAttribLocation(program, "corner");
gl.enableVertexAttribArray(corner);
gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
gl.enable(gl.BLEND);
gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
gl.clearColor(...behind, 1);
gl.viewport(0, 0, width, height);
const inverse = depths.map(z => 1 / z);
const still = (inverse[0] + inverse[planes - 1]) / 2;
const span = Math.max(inverse[0] - still, 1e-9 * inverse[0]);
const reach = motion * Math.max(width, height);
let x = 0, y = 0, forward = 0, wantedX = 0, wantedY = 0, wantedForward = 0, touched = false;
function draw() {
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.uniform2f(at("size"), width, height);
  gl.uniform2f(at("whole"), columns * width, Math.ceil(planes / columns) * height);
  gl.uniform2f(at("center"), lens[2] + 0.5, lens[3] + 0.5);
  for (let k = planes - 1; k >= 0; --k) {
    const parallax = reach * (inverse[k] - still) / span;
    const scale = (1 - forward * still / inverse[0]) / (1 - forward * inverse[k] / inverse[0]);
    gl.uniform2f(at("shift"), -x * parallax, -y * parallax);
    gl.uniform1f(at("scale"), scale);
    gl.uniform2f(at("cell"), k % columns * width, Math.floor(k / columns) * height);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}
function step(time) {
  if (!touched) {  // a slow circle until the mouse comes
    wantedX = 0.8 * Math.cos(time / 1500);
    wantedY = 0.5 * Math.sin(time / 1500);
  }
  x += 0.15 * (wantedX - x);
  y += 0.15 * (wantedY - y);
  forward += 0.15 * (wantedForward - forward);
  draw();
  requestAnimationFrame(step);
}
addEventListener("pointermove", event => {
  touched = true;
  wantedX = 2 * event.clientX / innerWidth - 1;
  wantedY = 2 * event.clientY / innerHeight - 1;
});
addEventListener("wheel", event => {
  wantedForward = Math.max(-0.5, Math.min(0.5, wantedForward - event.deltaY / 2000));
});
const image = new Image();
image.onload = () => {
  const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  if (Math.max(image.width, image.height) > most) {
    document.body.innerHTML = `<p>This device draws ${most} pixels a side at most.</p>`;
    return;
  }
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, true);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
    gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
  const place = location.hash.slice(1).split(",").map(Number);
  if (place.length === 2 && place.every(Number.isFinite)) {
    [x, y] = place;
    draw();
  } else requestAnimationFrame(step);
};
image.src = "data:image/png;base64,ATLAS";
</script>
</body>
</html>
"""
