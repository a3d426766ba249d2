"""The experiments on radiance fields."""

import json

import pytest

from cvkern.radiance import VoxelField, make_scene
from profiling.experiments import (
    planes_quality,
    radiance_quality,
    radiance_steps,
    splat_speed,
    wild_quality,
)

SETTINGS = VoxelField(resolutions=(16,), shares=(), degree=1, rays=64)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    for module in (radiance_quality, radiance_steps):
        monkeypatch.setattr(module, "make_scene", lambda: make_scene(train=4, test=1, size=24))
        monkeypatch.setattr(module, "suited", lambda field: SETTINGS)
    monkeypatch.setattr(radiance_quality, "VIEW", 16)
    monkeypatch.setattr(radiance_quality, "REPEATS", 1)
    monkeypatch.setattr(radiance_steps, "STEPS_TIMED", 3)
    monkeypatch.setattr(radiance_steps.clock, "COPY_BYTES", 2**20)
    monkeypatch.delenv("CVKERN_DATA", raising=False)
    monkeypatch.setenv("CVKERN_COMMIT", "abc")  # a tree with changes records no results


def test_quality(tmp_path, capsys):
    assert radiance_quality.main(["--seconds", "0.05", "0.5", "--output", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "radiance_quality_VoxelField_cpu.json").read_text())
    assert told["field"]["VoxelField"]["resolutions"] == [16]
    short, long = told["results"]["shapes"]["times"]
    assert short["steps"] < long["steps"]
    assert short["psnr"] < long["psnr"]
    assert long["rays_per_second"] > 64
    assert long["samples_per_second"] > 64
    assert f"psnr {long['psnr']}" in capsys.readouterr().out


def test_wild(tmp_path, monkeypatch, capsys):
    scene = make_scene(train=12, test=2, size=24)
    grid = VoxelField(resolutions=(16,), shares=(), rays=512)
    monkeypatch.setattr(wild_quality, "load_scene", lambda folder: scene)
    monkeypatch.setattr(wild_quality, "suited", lambda field: grid)
    options = ["--seconds", "1", "--changes", "occluder", "--output", str(tmp_path)]
    assert wild_quality.main([str(tmp_path), *options]) == 0
    told = json.loads((tmp_path / "wild_quality_lego_cpu.json").read_text())
    plain, robust, head, trimmed = told["results"]["occluder"]
    assert trimmed["trimmed"]
    for row in (plain, robust, head, trimmed):
        assert row["psnr_mapped"] > row["psnr"] - 0.05 > 15
    assert "psnr_mapped" in capsys.readouterr().out


def test_steps(tmp_path, capsys):
    options = ["--steps", "20", "--deterministic", "--output", str(tmp_path)]
    assert radiance_steps.main(options) == 0
    file = tmp_path / "radiance_steps_VoxelField_deterministic_cpu.json"
    told = json.loads(file.read_text())
    rows = {row["primitive"]: row for row in told["primitives"]}
    walked = {f"fields.voxel.rays.{name}" for name in ("render", "render_backward")}
    assert walked | {"pinhole.random_rays", "training.losses.loss"} <= set(rows)
    assert rows["fields.voxel.rays.render"]["gathered_mb"] > 0
    assert all(us > 0 for us in told["parts_us"].values())
    parts = sum(told["parts_us"].values())
    assert parts == pytest.approx(sum(row["us"] for row in told["primitives"]), rel=0.01)
    assert "samples/s" in capsys.readouterr().out


def test_planes(tmp_path, monkeypatch, capsys):
    scene = make_scene(train=6, test=2, size=32, layout="forward")
    monkeypatch.setattr(planes_quality, "scenes", lambda folder: {"small": scene})
    monkeypatch.setattr(planes_quality, "suited", lambda field: SETTINGS)
    assert planes_quality.main(["--seconds", "0.3", "--output", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "planes_quality_cpu.json").read_text())
    planes, other = told["results"]["small"]
    assert (planes["field"], other["field"]) == ("PlanesField", "VoxelField")
    assert planes["ssim"] > other["ssim"] + 0.1  # a sweep is a better start than fog
    assert "PlanesField" in capsys.readouterr().out


def test_speed_of_splats(capsys):
    assert splat_speed.main(["--splats", "300", "--size", "40", "30", "--times", "1"]) == 0
    said = capsys.readouterr().out
    assert "300 splats" in said
    assert all(f"{part} " in said for part in ("forward", "backward", "learning"))
