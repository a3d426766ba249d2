"""Colour PNG with 16 bits per channel: the one common kind of file that Pillow reduces to 8 bits.

References
----------
.. [1] Portable Network Graphics (PNG) Specification, third edition, W3C.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {2: 3, 4: 2, 6: 4}  # colour types RGB, grey + alpha, RGB + alpha
SUB, UP, AVERAGE, CLOSEST = 1, 2, 3, 4  # row filters, by the prediction that they subtract


def is_deep_colour(path: Path) -> bool:
    """Tell whether the file is a PNG with 16 bits per channel and two or more channels."""
    with path.open("rb") as file:
        head = file.read(26)
    return head[:8] == SIGNATURE and len(head) == 26 and head[24] == 16 and head[25] in CHANNELS


def read(path: Path) -> tuple[np.ndarray, int]:
    """Return the pixels, uint16 of shape (H, W, C) with C in 2, 3, 4, and the EXIF orientation.

    Raises
    ------
    ValueError
        If the file is damaged, or interlaced.
    """
    chunks = _chunks(path.read_bytes())
    width, height, _, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    if interlaced:
        raise ValueError("interlaced PNG with 16 bits per channel is not supported")
    step = 2 * CHANNELS[colour]  # bytes of a pixel
    size = height * (1 + width * step)
    try:  # decompress no more than the header says, because a small file could hold gigabytes
        raw = zlib.decompressobj().decompress(chunks.get(b"IDAT", b""), max(size, 1))
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if len(raw) != size:
        raise ValueError("the pixel data are incomplete")
    rows = np.frombuffer(raw, np.uint8).reshape(height, 1 + width * step)
    pixels = _unfilter(rows[:, 0], rows[:, 1:].reshape(height, width, step))
    image = pixels.view(">u2").astype(np.uint16)
    if b"tRNS" in chunks and colour == 2:  # one colour of the file means "transparent"
        key = np.frombuffer(chunks[b"tRNS"], ">u2")
        alpha = np.where((image == key).all(axis=-1), np.uint16(0), np.uint16(65535))
        image = np.dstack((image, alpha))
    return image, _orientation(chunks.get(b"eXIf", b""))


def write(path: Path, image: np.ndarray) -> None:
    """Encode uint16 of shape (H, W, C), C in 3, 4."""
    height, width, channels = image.shape
    colour = {3: 2, 4: 6}[channels]
    rows = np.ascontiguousarray(image.astype(">u2")).view(np.uint8).reshape(height, -1)
    above = np.concatenate((np.zeros_like(rows[:1]), rows[:-1]))
    filtered = np.concatenate((np.full((height, 1), UP, np.uint8), rows - above), axis=1)
    header = struct.pack(">IIBBBBB", width, height, 16, colour, 0, 0, 0)
    parts = [(b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b"")]
    path.write_bytes(SIGNATURE + b"".join(_chunk(name, data) for name, data in parts))


def _orientation(exif: bytes) -> int:
    if not exif:
        return 1
    from PIL import Image  # installed with imageio

    tags = Image.Exif()
    tags.load(exif)
    return tags.get(274, 1)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """Return the contents of each kind of chunk; repeated chunks (IDAT) are joined."""
    found: dict[bytes, list[bytes]] = {}
    at = len(SIGNATURE)
    while b"IEND" not in found:
        if at + 12 > len(data):
            raise ValueError("the file ends before its last chunk")
        (length,) = struct.unpack_from(">I", data, at)
        body = data[at + 4 : at + 8 + length]
        check = data[at + 8 + length : at + 12 + length]
        if check != struct.pack(">I", zlib.crc32(body)):
            raise ValueError(f"the checksum of chunk {body[:4]!r} is wrong")
        found.setdefault(body[:4], []).append(body[4:])
        at += 12 + length
    return {name: b"".join(parts) for name, parts in found.items()}


def _unfilter(kinds: np.ndarray, filtered: np.ndarray) -> np.ndarray:
    """Undo the row filters of section 9 of [1].

    A pixel needs its left, upper and upper left neighbours, so all pixels of one anti-diagonal
    (x + y = t) can be processed at once. In an array with an extra first row and column of zeros,
    they have a constant stride.
    """
    height, width, step = filtered.shape
    out = np.zeros((height + 1, width + 1, step), np.int16)
    flat, stride = out.reshape(-1, step), width  # (y + 1, x) is `width` after (y, x + 1)
    source = filtered.reshape(-1, step)
    for t in range(height + width - 1):
        first, last = max(0, t - width + 1), min(height - 1, t)
        count, kind = last - first + 1, kinds[first : last + 1, None]
        at = (first + 1) * (width + 1) + (t - first) + 1
        left, up, corner = (flat[at - back :: stride][:count] for back in (1, width + 1, width + 2))
        guess = left + up - corner
        to_left, to_up, to_corner = abs(guess - left), abs(guess - up), abs(guess - corner)
        closest = np.where(to_up <= to_corner, up, corner)
        closest = np.where((to_left <= to_up) & (to_left <= to_corner), left, closest)
        added = np.select(
            [kind == SUB, kind == UP, kind == AVERAGE, kind == CLOSEST],
            [left, up, (left + up) >> 1, closest],
            np.int16(0),
        )
        begin = first * width + (t - first)
        value = (source[begin :: max(width - 1, 1)][:count] + added) & 255
        flat[at::stride][:count] = value
    return out[1:, 1:].astype(np.uint8)
