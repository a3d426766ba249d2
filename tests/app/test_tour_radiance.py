"""The tour's chapter on radiance fields, after a training that is much too short."""

import numpy as np
import pytest

from cvkern.app.tour import crowds, radiance
from cvkern.app.tour.clock import Clock

STEPS = 70


@pytest.fixture
def quick(monkeypatch):
    fit = radiance.fit

    def steps(scene, field, *, seconds, **options):
        """Train for some steps, however busy the machine is."""
        return fit(scene, field, steps=STEPS, **options)

    monkeypatch.setattr(radiance, "fit", steps)
    monkeypatch.setattr(radiance, "FRAMES", 3)
    monkeypatch.setattr(radiance, "SPLATS", 512)
    monkeypatch.setattr(crowds, "STEPS", 40)


def test_chapter(quick):
    clock, chapter = Clock(), radiance.chapter()
    figures = [figure(clock) for figure in chapter.figures]
    learnt, panels = figures[1], {p.file: p.image for f in figures for p in f.panels}
    assert panels["radiance-photographs"].shape == (400, 800, 3)
    assert panels["radiance-truth"].shape == panels["radiance-render"].shape == (300, 300, 3)
    assert panels["radiance-orbit"].shape == (3, 200, 200, 3)
    assert panels["radiance-depth"].shape == (200, 200, 3)
    assert panels["radiance-splats"].shape == (3, 200, 200, 3)
    assert panels["radiance-splats"].std(axis=(1, 2)).min() > 20  # there is something to see
    assert panels["radiance-planes"].shape == (3, 250, 371, 3)
    assert panels["radiance-planes"].std(axis=0).mean() > 3  # it moves
    assert panels["crowds-kept"].shape == panels["crowds-taken"].shape == (192, 192, 3)
    assert panels["crowds-lights"].std(axis=0).mean() > 1  # the light changes
    assert panels["radiance-curve"].shape == (600, 600, 3)
    assert all(image.dtype == np.uint8 for image in panels.values())
    off = panels["radiance-truth"].astype(float) - panels["radiance-render"]
    blank = 255.0 - panels["radiance-truth"]
    assert (off**2).mean() < 0.2 * (blank**2).mean()
    assert [timing.function for timing in learnt.timings] == ["render"]
    assert f"seconds={radiance.SECONDS:g}" in learnt.call
