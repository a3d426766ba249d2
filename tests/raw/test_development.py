"""Tone curves and the way from samples to a picture, and the commands."""

import json

import imageio.v3 as iio
import numpy as np
import pytest
import skimage.data
import tifffile
from PIL import Image

import cvkern
from cvkern.app import cli
from cvkern.color import spaces

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("method", ["reinhard", "reinhard_local", "bilateral", "local_laplacian"])
def test_tone_curves(method):
    x = np.linspace(-6, 8, 90)
    radiance = 2.0 ** (x[None, :] + RNG.normal(0, 0.05, (60, 1)))
    shown = cvkern.tone_map(radiance, method)
    assert shown.dtype == np.float32
    assert shown.min() >= 0
    assert shown.max() <= 1
    rising = np.diff(shown, axis=1)[shown[:, 1:] < 1] > 0
    assert rising.mean() > 0.95
    scaled = cvkern.tone_map(radiance * 64, method)
    np.testing.assert_allclose(scaled, shown, rtol=1e-4)
    colours = radiance[..., None] * [1.0, 0.5, 0.25]
    found = cvkern.tone_map(colours, method)
    inside = found[..., 0] < 1
    np.testing.assert_allclose(found[inside][:, 1], found[inside][:, 0] / 2, rtol=1e-5)
    assert not cvkern.tone_map(np.zeros((4, 5)), method).any()


def test_reinhard_is_its_equation():
    light = RNG.uniform(0.01, 50, (8, 9))
    scaled = light * 0.18 / np.exp(np.mean(np.log(light)))
    want = scaled * (1 + scaled / scaled.max() ** 2) / (1 + scaled)
    np.testing.assert_allclose(cvkern.tone_map(light), want, rtol=1e-5)


def test_the_bilateral_filter_keeps_edges():
    step = np.where(np.arange(80) < 40, 1.0, 1000.0) * np.ones((60, 1))
    texture = 1 + 0.05 * np.sin(np.arange(80))
    shown = cvkern.tone_map(step * texture, "bilateral", contrast=10)
    low, high = shown[30, :36], shown[30, 44:]
    assert high.mean() / low.mean() == pytest.approx(10, rel=0.05)
    np.testing.assert_allclose(low / low.mean(), texture[:36] / texture[:36].mean(), rtol=0.02)


def test_develop_undoes_what_a_camera_does(backend):
    """Constant patches under coloured light, with a black level: they come back, to a code."""
    patches = np.array([[0.2, 0.4, 0.6], [0.5, 0.5, 0.5], [0.8, 0.3, 0.1], [0.05, 0.6, 0.3]])
    image = np.repeat(np.repeat(patches.reshape(2, 2, 3), 24, 0), 24, 1)
    light = np.array([0.6, 1.0, 0.4])
    raw = np.rint(cvkern.mosaic(image * light, "GBRG") * 3000 + 256).astype(np.uint16)
    got = cvkern.develop(raw, "GBRG", black=256, white=3256, illuminant=light)
    want = cvkern.convert_color(image, "rgb", "srgb", dtype=np.uint8)
    centres = np.s_[12::24, 12::24]
    assert np.abs(got[centres].astype(int) - want[centres]).max() <= 1
    real = cvkern.develop(raw, "GBRG", black=256, white=3256, illuminant=light, dtype="float32")
    np.testing.assert_allclose(real * 255, got, atol=0.51)


@pytest.mark.parametrize("light", [(0.5, 1, 0.7), (1, 0.5, 0.7)])
def test_highlights_are_white(light):
    raw = cvkern.mosaic(np.minimum(np.full((16, 16, 3), 2.0) * light, 1))
    for highlights in ("rebuild", "clip"):
        got = cvkern.develop(raw, white=1, illuminant=light, highlights=highlights)
        assert (got == 255).all()


def test_a_white_too_small_for_float32():
    got = cvkern.develop(np.full((4, 6), 3.0), white=1e-320, illuminant=(1, 1, 1))
    assert (got == 255).all()


def test_color_matrix():
    true = np.array([[1.6, -0.4, -0.2], [-0.3, 1.5, -0.2], [0.1, -0.6, 1.5]])
    measured = RNG.random((24, 3))
    np.testing.assert_allclose(cvkern.fit_color_matrix(measured, measured @ true.T), true)
    noisy = cvkern.fit_color_matrix(measured, measured @ true.T + RNG.normal(0, 0.02, (24, 3)))
    np.testing.assert_allclose(noisy.sum(axis=1), 1)
    np.testing.assert_allclose(noisy, true, atol=0.05)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("white must be above black, 9, got 3",
         lambda: cvkern.develop(np.ones((4, 4)), black=9, white=3)),
        ("highlights must be one of ('clip', 'rebuild'), got 'x'",
         lambda: cvkern.develop(np.ones((4, 4)), highlights="x")),
        ("matrix must have shape (3, 3), got (2, 2)",
         lambda: cvkern.develop(np.ones((4, 4)), illuminant=(1, 1, 1), matrix=np.eye(2))),
        ("measured must have shape (N >= 3, 3), got (2, 3)",
         lambda: cvkern.fit_color_matrix(np.ones((2, 3)), np.ones((2, 3)))),
        ("key must be > 0, got 0", lambda: cvkern.tone_map(np.ones((4, 4)), key=0)),
        ("radiance must have 1 or 3 channels, got shape (4, 4, 2)",
         lambda: cvkern.tone_map(np.ones((4, 4, 2)))),
    ],
)  # fmt: skip
def test_errors(message, call):
    with pytest.raises(ValueError) as info:  # noqa: PT011  (the whole message is compared)
        call()
    assert str(info.value) == message


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr("sys.argv", ["cvkern", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code, capsys.readouterr()


def write_dng(file, raw, to_camera, neutral):
    """Write samples of 12 bits, black at 256, of a camera that was turned."""
    ratios = [(round(1e4 * float(v)), 10**4) for v in (*to_camera.ravel(), *neutral)]
    matrix, white = (sum(part, ()) for part in (ratios[:9], ratios[9:]))
    tags = [
        (274, 3, 1, 6, True), (33421, 3, 2, (2, 2), True), (33422, 1, 4, bytes([1, 2, 0, 1]), True),
        (50706, 1, 4, bytes([1, 4, 0, 0]), True), (50708, 2, 0, "cvkern", True),
        (50714, 3, 1, 256, True), (50717, 3, 1, 4095, True), (50721, 10, 9, matrix, True),
        (50728, 5, 3, white, True), (50778, 3, 1, 21, True),
    ]  # fmt: skip
    tifffile.imwrite(file, raw, photometric=32803, extratags=tags, metadata=None)


def test_a_file_of_a_camera(monkeypatch, capsys, tmp_path):
    """Colours come back by the light and the matrix in the file, and upright."""
    pytest.importorskip("rawpy")
    codes = skimage.data.chelsea()[:96, 100:220]
    linear = cvkern.convert_color(codes, "srgb", "rgb")
    to_camera = np.array([[0.672, -0.064, -0.096], [-0.429, 1.246, 0.203], [-0.091, 0.216, 0.567]])
    mixed = to_camera @ spaces.TO_XYZ
    seen = linear @ mixed.T
    neutral = mixed @ np.ones(3)
    scale = 3800 / seen.max()
    raw = cvkern.mosaic(np.ascontiguousarray(seen * scale), "GBRG").clip(0) + 256
    write_dng(tmp_path / "a.dng", raw.round().astype(np.uint16), to_camera, neutral / neutral.max())
    want = linear / linear.sum(axis=2, keepdims=True)
    # The cat is orange, and an estimate takes a part of that for the light.
    for words, most in (((), 0.025), (("--light", "estimate"), 0.12)):
        given = "develop", tmp_path / "a.dng", "-o", tmp_path / "o.png", *words
        assert run(monkeypatch, capsys, *given)[0] == 0
        found = np.rot90(cvkern.convert_color(iio.imread(tmp_path / "o.png"), "srgb", "rgb"))
        # Without the matrix it is 0.062 and 0.128; without the turn the shapes differ.
        assert np.abs(found / found.sum(axis=2, keepdims=True) - want).mean() < most
    iio.imwrite(tmp_path / "a.png", np.zeros((8, 8), np.uint8))
    (tmp_path / "b.nef").write_bytes(b"no picture")
    for name, words, message in (
        ("b.nef", (), "RAW must be a camera's raw file"),
        ("a.png", ("--light", "camera"), "light must be 'estimate' for"),
        ("a.png", ("--light", "sun"), "light must be 'camera' or 'estimate', got 'sun'"),
    ):
        given = "develop", tmp_path / name, "-o", tmp_path / "o.png", *words
        code, said = run(monkeypatch, capsys, *given)
        assert (code, message in " ".join(said.err.split())) == (2, True)


def test_commands(monkeypatch, capsys, tmp_path):
    raw = RNG.integers(0, 4096, (20, 24)).astype(np.uint16)
    iio.imwrite(tmp_path / "raw.png", raw)
    code, said = run(monkeypatch, capsys, "develop", tmp_path / "raw.png", "-o", tmp_path / "o.png")
    assert code == 0
    assert "o.png: 20 x 24" in said.out
    np.testing.assert_array_equal(iio.imread(tmp_path / "o.png"), cvkern.develop(raw))
    folder = tmp_path / "stack"
    folder.mkdir()
    light = RNG.random((40, 50, 3))
    for k, t in enumerate((0.25, 0.5, 1)):
        iio.imwrite(folder / f"{k}.png", np.uint8(255 * (light * t) ** 0.45))
    words = ("hdr", folder, "-o", tmp_path / "h.png")
    code, said = run(monkeypatch, capsys, *words)
    assert code == 2
    assert "exposure_seconds.json" in said.err
    code, _ = run(monkeypatch, capsys, *words, "--seconds", "1/4,1/2,1", "--align",
                  "--radiance", tmp_path / "r.npy")  # fmt: skip
    assert code == 0
    assert np.load(tmp_path / "r.npy").shape == (40, 50, 3)
    code, said = run(monkeypatch, capsys, *words, "--seconds", "1", "--radiance",
                     tmp_path / "r.npy")  # fmt: skip
    assert code == 2
    assert "radiance must be a new file" in said.err.replace("\n", " ")
    code, said = run(monkeypatch, capsys, "hdr", folder, "-o", folder / "1.png", "--tone", "fuse")
    assert code == 2
    assert "output must not be a file that is read" in said.err.replace("\n", " ")
    for broken in ("[" * 100_000, '{"0.png": null, "1.png": 1, "2.png": 2}', "[1, 2, 3]"):
        (folder / "exposure_seconds.json").write_text(broken)
        code, said = run(monkeypatch, capsys, *words)
        assert code == 2
        assert "exposure_seconds.json must have a time" in said.err.replace("\n", " ")
    times = {f"{k}.png": t for k, t in enumerate((0.25, 0.5, 1))}
    (folder / "exposure_seconds.json").write_text(json.dumps(times))
    assert run(monkeypatch, capsys, *words)[0] == 0
    assert run(monkeypatch, capsys, *words, "--tone", "fuse")[0] == 0
    assert run(monkeypatch, capsys, *words, "--tone", "local_laplacian")[0] == 0
    code, said = run(monkeypatch, capsys, *words, "--seconds", "1,1/2,1/4")
    assert code == 2
    assert "seconds must be in the order of the images" in said.err.replace("\n", " ")
    iio.imwrite(folder / "other.png", raw.astype(np.uint8))
    code, said = run(monkeypatch, capsys, *words, "--tone", "fuse")
    assert code == 2
    assert "got (20, 24) of other.png" in said.err.replace("\n", " ")
    camera = tmp_path / "camera"
    camera.mkdir()
    for k, t in enumerate((0.25, 0.5, 1)):
        exif = Image.Exif()
        exif.get_ifd(0x8769)[0x829A] = t
        Image.fromarray(iio.imread(folder / f"{k}.png")).save(camera / f"{k}.jpg", exif=exif)
    assert run(monkeypatch, capsys, "hdr", camera, "-o", tmp_path / "c.png")[0] == 0
    iio.imwrite(tmp_path / "raw.dng", raw, extension=".png")
    code, said = run(monkeypatch, capsys, "develop", tmp_path / "raw.dng", "-o", tmp_path / "p.png")
    assert code == 2
