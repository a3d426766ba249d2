"""Meshes as binary glTF 2.0, one file for viewers and game engines."""

from __future__ import annotations

import json
import struct

import numpy as np

FLOAT, UINT16, UINT32 = 5126, 5123, 5125  # glTF's types of components
CORNERS, INDICES = 34962, 34963  # glTF's uses of a part of the buffer
# A turn about x by -90 degrees, column by column: z becomes y, which is up in glTF.
UPRIGHT = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


def glb(points: np.ndarray, faces: np.ndarray, colors: np.ndarray) -> bytes:
    """Return a mesh as a file: points (N, 3), faces (F, 3), colours (N, 3) in bytes of sRGB."""
    if not len(faces):
        raise ValueError("surface.faces must have a triangle, got none")
    places = np.ascontiguousarray(points, "<f4")
    # Colours of corners are linear in glTF, and rows of four bytes or a multiple.
    tints = np.full((len(points), 4), 65535, "<u2")
    tints[:, :3] = np.round(65535 * _linear(colors / 255.0))
    corners = np.ascontiguousarray(faces, "<u4")
    data, views = b"", []
    for array, use in ((places, CORNERS), (tints, CORNERS), (corners, INDICES)):
        views.append(
            {"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes, "target": use}
        )
        data += array.tobytes()
    accessors = [
        {
            "bufferView": 0, "componentType": FLOAT, "count": len(points), "type": "VEC3",
            "min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist(),
        },
        {
            "bufferView": 1, "componentType": UINT16, "normalized": True, "count": len(points),
            "type": "VEC4",
        },
        {"bufferView": 2, "componentType": UINT32, "count": corners.size, "type": "SCALAR"},
    ]  # fmt: skip
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}
    rough = {"metallicFactor": 0, "roughnessFactor": 1}
    content = {
        "asset": {"version": "2.0", "generator": "cvkern"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": UPRIGHT}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"pbrMetallicRoughness": rough, "doubleSided": True}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def _linear(values: np.ndarray) -> np.ndarray:
    """Return the light of values of sRGB (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
