"""Image files of every kind."""

import os
import struct
import zlib

import cv2
import imageio.v3 as iio
import numpy as np
import PIL.Image
import pytest
import tifffile

from cvkern import images
from cvkern.images._formats import KEPT

SHAPES = {0: (13, 17), 3: (13, 17, 3), 4: (13, 17, 4)}
KINDS = [
    (suffix, dtype, channels)
    for suffix, (dtypes, allowed) in KEPT.items()
    if suffix not in (".jpg", ".jpeg")
    for dtype in dtypes
    for channels in allowed
]


def noise(dtype, shape=(13, 17), seed=0):
    rng = np.random.default_rng(seed)
    if np.dtype(dtype).kind == "f":
        return rng.standard_normal(shape).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max + 1, shape, dtype=dtype)


@pytest.mark.parametrize(("suffix", "dtype", "channels"), KINDS)
def test_round_trip(tmp_path, suffix, dtype, channels):
    image = noise(dtype, SHAPES[channels])
    path = tmp_path / f"image{suffix}"
    images.write_image(path, image)
    back = images.read_image(path)
    assert back.dtype == dtype
    assert np.array_equal(back, image)
    assert back.flags.c_contiguous
    assert back.flags.writeable
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("shape", [(64, 48), (64, 48, 3)])
def test_jpeg_is_close(tmp_path, shape):
    y, x = np.indices(shape[:2])
    image = (128 + 60 * np.sin(y / 9) + 60 * np.cos(x / 11)).astype(np.uint8)
    image = image if len(shape) == 2 else np.repeat(image[..., None], 3, axis=2)
    images.write_image(tmp_path / "image.jpg", image)
    back = images.read_image(tmp_path / "image.jpg")
    assert back.shape == image.shape
    assert np.abs(back.astype(int) - image).max() <= 4


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (1, 1, 3), (1, 5, 4), (5, 1, 3)])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_narrow_images(tmp_path, shape, dtype, suffix):
    image = noise(dtype, shape)
    images.write_image(tmp_path / f"i{suffix}", image)
    assert np.array_equal(images.read_image(tmp_path / f"i{suffix}"), image)


def test_bool_is_written_as_black_and_white(tmp_path):
    mask = noise("uint8") > 99
    images.write_image(tmp_path / "mask.png", mask)
    assert np.array_equal(images.read_image(tmp_path / "mask.png"), mask * np.uint8(255))


def test_float64_is_written_as_float32(tmp_path):
    image = noise("float64")
    images.write_image(tmp_path / "i.tif", image)
    assert np.array_equal(images.read_image(tmp_path / "i.tif"), image.astype(np.float32))


def test_strided_and_foreign_byte_order(tmp_path):
    image = noise("uint16", (26, 34, 3))
    images.write_image(tmp_path / "i.png", image[::2, ::-2].astype(">u2"))
    assert np.array_equal(images.read_image(tmp_path / "i.png"), image[::2, ::-2])


@pytest.mark.parametrize("channels", [0, 3, 4])
@pytest.mark.parametrize("smooth", [False, True])
def test_deep_png_of_opencv(tmp_path, channels, smooth):
    image = noise("uint16", (40, *SHAPES[channels][1:]))
    if smooth:  # so that the encoder takes to all of its row filters
        image = (np.cumsum(np.cumsum(image % 64, axis=0), axis=1) % 65536).astype(np.uint16)
    swapped = image if channels == 0 else image[..., [2, 1, 0, 3][:channels]]
    cv2.imwrite(str(tmp_path / "i.png"), swapped)
    assert np.array_equal(images.read_image(tmp_path / "i.png"), image)
    images.write_image(tmp_path / "own.png", image)
    read = cv2.imread(str(tmp_path / "own.png"), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert np.array_equal(read, swapped)


def filtered_png(path, rows, color, filters, chunks=()):
    """Write a 16-bit PNG with the given filter for each row, by the formulas of the standard."""
    height, width, step = rows.shape[0], rows.shape[1], 2 * rows.shape[2]
    raw = np.ascontiguousarray(rows.astype(">u2")).view(np.uint8).reshape(height, -1).astype(int)
    out = b""
    for y, kind in enumerate(filters):
        line = bytearray()
        for i in range(width * step):
            a = raw[y, i - step] if i >= step else 0
            b = raw[y - 1, i] if y else 0
            c = raw[y - 1, i - step] if y and i >= step else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            guess = (0, a, b, (a + b) // 2, nearest)[kind]
            line.append((raw[y, i] - guess) % 256)
        out += bytes([kind]) + bytes(line)

    def chunk(name, data):
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 16, color, 0, 0, 0)
    data = zlib.compress(out)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(chunk(*c) for c in chunks)
        + chunk(b"IDAT", data[:50]) + chunk(b"IDAT", data[50:]) + chunk(b"IEND", b"")
    )  # fmt: skip


def test_deep_png_row_filters_and_gray_alpha(tmp_path):
    rows = noise("uint16", (11, 7, 3))
    filtered_png(tmp_path / "rgb.png", rows, 2, [4, 3, 2, 1, 0, 4, 4, 3, 3, 1, 4])
    assert np.array_equal(images.read_image(tmp_path / "rgb.png"), rows)
    rows = noise("uint16", (5, 6, 2))
    filtered_png(tmp_path / "la.png", rows, 4, [0, 1, 2, 3, 4])
    assert np.array_equal(images.read_image(tmp_path / "la.png"), rows[..., [0, 0, 0, 1]])


def test_deep_png_transparent_colour(tmp_path):
    rows = noise("uint16", (4, 5, 3))
    key = struct.pack(">HHH", *rows[2, 3])
    filtered_png(tmp_path / "i.png", rows, 2, [0] * 4, [(b"tRNS", key)])
    back = images.read_image(tmp_path / "i.png")
    assert np.array_equal(back[..., :3], rows)
    assert back[2, 3, 3] == 0
    assert (back[..., 3] == 0).sum() == 1


def test_deep_tiff_planes_and_orientation(tmp_path):
    image = noise("uint16", (6, 9, 3))
    tag = [(274, "H", 1, 6, True)]
    tifffile.imwrite(
        tmp_path / "i.tif",
        np.moveaxis(image, -1, 0),
        photometric="rgb",
        planarconfig="separate",
        extratags=tag,
    )
    assert np.array_equal(images.read_image(tmp_path / "i.tif"), np.rot90(image, -1))
    assert np.array_equal(images.read_image(tmp_path / "i.tif", orient=False), image)


# What a stored image must become so that its top is up, by the EXIF standard.
TURNS = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: lambda a: np.swapaxes(a, 0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.swapaxes(np.rot90(a, 2), 0, 1),
    8: np.rot90,
}


@pytest.mark.parametrize("orientation", TURNS)
@pytest.mark.parametrize("suffix", [".png", ".webp", ".tif", ".jpg"])
@pytest.mark.parametrize("shape", [(8, 16), (8, 16, 3)])
def test_exif_orientation(tmp_path, orientation, suffix, shape):
    if suffix == ".webp" and len(shape) == 2:
        pytest.skip("WebP has no grey")
    path = tmp_path / f"i{suffix}"
    image = np.zeros(shape, np.uint8)
    image[:, 8:] = 90  # flat in blocks of 8, which JPEG keeps
    image[:, 8:].reshape(-1)[:] = 90
    image[:4, :8] = 200
    if suffix == ".tif":
        tag = [(274, "H", 1, orientation, True)]
        kind = "rgb" if len(shape) == 3 else "minisblack"
        tifffile.imwrite(path, image, photometric=kind, extratags=tag)
    else:
        exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"
        exif += struct.pack("<HHI", orientation, 0, 0)
        options = {".webp": {"lossless": True}, ".jpg": {"quality": 100}}.get(suffix, {})
        iio.imwrite(path, image, plugin="pillow", exif=exif, **options)
    turned, stored = images.read_image(path), images.read_image(path, orient=False)
    close = 6 if suffix == ".jpg" else 0
    assert turned.shape == TURNS[orientation](image).shape
    assert np.abs(turned.astype(int) - TURNS[orientation](image)).max() <= close
    assert np.abs(stored.astype(int) - image).max() <= close


def test_exif_orientation_of_deep_png(tmp_path):
    rows = noise("uint16", (4, 5, 3))
    exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    filtered_png(tmp_path / "i.png", rows, 2, [0] * 4, [(b"eXIf", exif)])
    assert np.array_equal(images.read_image(tmp_path / "i.png"), np.rot90(rows, -1))
    assert np.array_equal(images.read_image(tmp_path / "i.png", orient=False), rows)


def pillow_image(tmp_path, name, image, mode, **options):
    from PIL import Image

    made = Image.fromarray(image)
    made = made.convert(mode) if made.mode != mode else made
    made.save(tmp_path / name, **options)
    return images.read_image(tmp_path / name)


def test_palette_is_expanded(tmp_path):
    from PIL import Image

    index = noise("uint8", (9, 12)) % 4
    palette = [10, 20, 30, 200, 0, 0, 0, 200, 0, 0, 0, 200]
    made = Image.fromarray(index).convert("P")
    made.putdata(index.ravel().tolist())
    made.putpalette(palette)
    made.save(tmp_path / "plain.png")
    made.save(tmp_path / "keyed.png", transparency=2)
    colors = np.array(palette, np.uint8).reshape(4, 3)[index]
    assert np.array_equal(images.read_image(tmp_path / "plain.png"), colors)
    keyed = images.read_image(tmp_path / "keyed.png")
    assert np.array_equal(keyed[..., :3], colors)
    assert np.array_equal(keyed[..., 3] == 0, index == 2)


def test_kinds_of_pillow(tmp_path):
    gray = noise("uint8")
    bits = pillow_image(tmp_path, "bits.png", (gray > 99) * np.uint8(255), "1")
    assert np.array_equal(bits, (gray > 99) * np.uint8(255))
    alpha = pillow_image(tmp_path, "la.png", gray, "LA")
    assert np.array_equal(alpha[..., :3], np.repeat(gray[..., None], 3, axis=2))
    assert (alpha[..., 3] == 255).all()
    color = noise("uint8", (13, 17, 3))
    assert np.array_equal(pillow_image(tmp_path, "cmyk.tif", color, "CMYK"), color)
    pgm = b"P5 3 2 65535\n" + np.array([[1, 2, 3], [4, 500, 65535]], ">u2").tobytes()
    (tmp_path / "i.pgm").write_bytes(pgm)
    deep = images.read_image(tmp_path / "i.pgm")
    assert deep.dtype == np.uint16
    assert deep.tolist() == [[1, 2, 3], [4, 500, 65535]]


def test_first_of_several(tmp_path):
    stack = noise("uint8", (3, 8, 9, 3))
    tifffile.imwrite(tmp_path / "i.tif", stack, photometric="rgb")
    assert np.array_equal(images.read_image(tmp_path / "i.tif"), stack[0])


@pytest.mark.parametrize(("name", "data", "reason"), [
    ("text.png", b"not an image", "it has no format"),
    ("empty.png", b"", "it has no format"),
    ("empty.tif", b"", ""),
    ("short.tif", b"II*\0\x08\0\0\0", ""),
    ("phone.heic", b"\0\0\0\x18ftypheic", "it is HEIC: save it as JPEG"),
])  # fmt: skip
def test_files_that_are_no_images(tmp_path, name, data, reason):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ValueError, match=f"path must be a readable image, got .*{name}.*{reason}"):
        images.read_image(tmp_path / name)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp", ".bmp"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_truncated_files(tmp_path, suffix, dtype):
    if dtype not in KEPT[suffix][0]:
        pytest.skip("no such format")
    path = tmp_path / f"i{suffix}"
    images.write_image(path, noise(dtype, (40, 50, 3)))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match="readable image"):
        images.read_image(path)


def test_a_bitmap_of_more_pixels_than_its_bytes_hold(tmp_path):
    path = tmp_path / "i.bmp"
    images.write_image(path, noise("uint8", (40, 1, 3)))
    data = bytearray(path.read_bytes())
    data[25] = 16  # the height is 2^28 + 40 rows, for which Pillow would take 4 GB
    path.write_bytes(data)
    with pytest.raises(ValueError, match="its bytes hold at most"):
        images.read_image(path)


def test_damaged_deep_png(tmp_path):
    path = tmp_path / "i.png"
    images.write_image(path, noise("uint16", (40, 50, 3)))
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(data)
    with pytest.raises(ValueError, match="checksum"):
        images.read_image(path)


def test_unsupported_pixels(tmp_path):
    from PIL import Image

    Image.fromarray(noise("uint8", (4, 5, 3))).convert("LAB").save(tmp_path / "lab.tif")
    with pytest.raises(ValueError, match="kind LAB"):
        images.read_image(tmp_path / "lab.tif")
    tifffile.imwrite(tmp_path / "wide.tif", np.array([[1, 70000]], np.int32))
    with pytest.raises(ValueError, match="more than 16 bits"):
        images.read_image(tmp_path / "wide.tif")
    tifffile.imwrite(tmp_path / "five.tif", noise("uint16", (4, 6, 5)), planarconfig="contig")
    with pytest.raises(ValueError, match="shape"):
        images.read_image(tmp_path / "five.tif")


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"exists, got .*none\.png"):
        images.read_image(tmp_path / "none.png")
    with pytest.raises(ValueError, match="must be a file"):
        images.read_image(tmp_path)
    with pytest.raises(FileNotFoundError, match="folder that exists"):
        images.write_image(tmp_path / "none" / "i.png", noise("uint8"))
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(ValueError, match="regular file"):
        images.write_image(tmp_path / "folder.png", noise("uint8"))
    assert [p.name for p in tmp_path.iterdir()] == ["folder.png"]


@pytest.mark.parametrize(
    ("name", "image", "rule"),
    [
        ("i.xyz", noise("uint8"), "path must end in one of"),
        ("i", noise("uint8"), "path must end in one of"),
        ("i.jpg", noise("uint16"), r"image must be uint8 for \.jpg, got uint16"),
        ("i.png", noise("float32"), "uint8 or uint16"),
        ("i.png", noise("int32"), "uint8 or uint16"),
        ("i.jpg", noise("uint8", (4, 5, 4)), "shape"),
        ("i.bmp", noise("uint8", (4, 5, 4)), "shape"),
        ("i.png", noise("uint8", (4, 5, 2)), "shape"),
        ("i.png", noise("uint8", (5,)), "shape"),
        ("i.png", noise("uint8", (2, 4, 5, 3)), "shape"),
        ("i.png", np.empty((0, 5), np.uint8), "empty"),
        ("i.png", np.ones((3, 4), complex), "real numbers"),
    ],
)
def test_what_cannot_be_written(tmp_path, name, image, rule):
    with pytest.raises(ValueError, match=rule):
        images.write_image(tmp_path / name, image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["i.png", "i.tif", "i.jpg"])
def test_a_failing_write_leaves_the_old_file(tmp_path, monkeypatch, name):
    path = tmp_path / name
    images.write_image(path, noise("uint8"))
    before = path.read_bytes()

    def fail(file, *args, **options):
        with open(file, "wb") as stream:
            stream.write(b"half of it")
        raise OSError("the disk is full")

    monkeypatch.setattr(iio, "imwrite", fail)
    monkeypatch.setattr(tifffile, "imwrite", fail)
    with pytest.raises(OSError, match="full"):
        images.write_image(path, noise("uint8", seed=1))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_link_stays_a_link(tmp_path):
    images.write_image(tmp_path / "real.png", noise("uint8"))
    os.symlink(tmp_path / "real.png", tmp_path / "link.png")
    images.write_image(tmp_path / "link.png", noise("uint8", seed=1))
    assert (tmp_path / "link.png").is_symlink()
    assert np.array_equal(images.read_image(tmp_path / "real.png"), noise("uint8", seed=1))


@pytest.mark.parametrize("name", ["i.png", "i.bmp", "i.tif"])
def test_what_is_written_can_be_read_however_large(tmp_path, monkeypatch, name):
    """Pillow's own limit is no matter of ours, and stays what it was."""
    image = noise("uint8", (30, 40))
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 100)
    images.write_image(tmp_path / name, image)
    np.testing.assert_array_equal(images.read_image(tmp_path / name), image)
    assert PIL.Image.MAX_IMAGE_PIXELS == 100
    monkeypatch.setattr("cvkern.images._formats.MAX_ELEMENTS", 600)
    with pytest.raises(ValueError, match="it has more than 600 pixels"):
        images.read_image(tmp_path / name)
