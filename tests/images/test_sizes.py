"""Image files that claim more pixels than they can hold."""

import zlib

import numpy as np
import pytest
import tifffile

from cvkern import images


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_tiff_that_cannot_hold_its_pixels_is_refused_before_they_are_held(tmp_path, compression):
    path = tmp_path / "i.tif"
    tifffile.imwrite(path, np.zeros((60, 50), np.uint8), compression=compression)
    assert images.read_image(path).shape == (60, 50)  # zeros are compressed well
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags["ImageLength"].overwrite(9_000_000)
    with pytest.raises(ValueError, match=r"path .* 9000000 x 50 pixels are 450000000 bytes"):
        images.read_image(path)


def test_a_png_that_cannot_hold_its_pixels_is_refused(tmp_path):
    path = tmp_path / "i.png"
    images.write_image(path, np.zeros((6, 5), np.uint8))
    content = bytearray(path.read_bytes())
    content[16:24] = (20_000).to_bytes(4, "big") * 2
    content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"path .* 20000 x 20000 pixels, and its bytes hold"):
        images.read_image(path)
