"""Planes of several reference cameras: what they learn together, their files, what they refuse."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cvkern
from cvkern.radiance import (
    PlanesField,
    evaluate,
    fit,
    load_model,
    make_scene,
    render,
    write_planes,
)
from cvkern.radiance.fields.blended import BlendedStacks, groups_of
from cvkern.radiance.scenes import solids
from tests.radiance.runs import interrupt, press_ctrl_c, same

ONE = PlanesField(planes=8, rays=1024)
TWO = replace(ONE, references=2)
GAIN = 5.0  # measured on held-out views after 150 steps, dB


@pytest.fixture(scope="module")
def scene():
    """A room seen from places that are as far apart as the room is deep."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solids, "ASIDE", 1.5)
        patch.setattr(solids, "ROOM_DEPTHS", (1.0, 14.0))
        return make_scene(train=20, test=4, size=48, layout="forward")


@pytest.fixture(scope="module")
def model(scene):
    return fit(scene, TWO, steps=150, progress=False)


def stacks(model):
    assert isinstance(model.field, BlendedStacks)
    return model.field.stacks


def test_two_references_show_what_one_does_not(scene, model):
    alone = fit(scene, ONE, steps=150, progress=False)
    seen = [evaluate(m, scene).psnr.mean() for m in (alone, model)]
    assert seen[1] > seen[0] + GAIN - 1
    more = fit(scene, replace(ONE, planes=16), steps=150, progress=False)  # 16 planes as well
    assert seen[1] > evaluate(more, scene).psnr.mean() + GAIN - 1


def test_each_reference_sees_its_own_side(scene, model):
    places = [stack.reference.pose[:, 3] for stack in stacks(model)]
    eyes = model.frame.inside(scene.cameras.poses)[:, :, 3]
    apart = np.linalg.norm(eyes[:, None] - eyes[None], axis=2).max()
    assert np.linalg.norm(places[0] - places[1]) > 0.2 * apart
    few = stacks(fit(scene, replace(TWO, texels=4000), steps=1, progress=False))
    assert 2000 < sum(np.prod(stack.texels.shape[:3]) for stack in few) <= 4000


def test_files(scene, model, tmp_path):
    whole, small = tmp_path / "whole.npz", tmp_path / "small.npz"
    model.save(whole)
    model.save(small, resumable=False)
    seen = render(model, scene.cameras, 2)
    np.testing.assert_array_equal(render(load_model(whole), scene.cameras, 2).color, seen.color)
    rounded = render(load_model(small), scene.cameras, 2)
    assert 0 < np.abs(rounded.color - seen.color).max() < 0.05
    content = whole.read_bytes()
    whole.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=r"whole\.npz"):
        load_model(whole)


def test_a_stopped_training_goes_on(scene, tmp_path, monkeypatch):
    file, shiny = tmp_path / "model.npz", replace(TWO, basis=2)
    straight = fit(scene, shiny, steps=40, progress=False)
    with monkeypatch.context() as patch:
        interrupt(patch, 21, press_ctrl_c)
        fit(scene, shiny, steps=40, checkpoint=file, progress=False)
    on = fit(scene, "planes", steps=40, checkpoint=file, resume=True, progress=False)
    assert same(on, straight)


def test_training_is_the_same_with_any_number_of_threads(scene, monkeypatch):
    models = []
    for threads in ("1", "2"):
        monkeypatch.setenv("CVKERN_NUM_THREADS", threads)
        with cvkern.use(backend="warp", device="cpu"):
            models.append(fit(scene, TWO, steps=20, progress=False))
    assert same(*models)


def test_kernel_sets_agree(scene):
    seen = []
    for backend in ("warp", "taichi"):
        with cvkern.use(backend=backend, device="cpu"):
            found = fit(scene, TWO, steps=5, progress=False)
            seen.append(render(found, scene.cameras, 3).color)
    # A step of Adam moves a parameter by up to 0.1, also where a gradient is nearly 0.
    assert np.abs(seen[0] - seen[1]).mean() < 1e-3


def test_the_planes_of_each_reference_become_a_page(model, tmp_path):
    pages = []
    for number in range(2):
        write_planes(model, tmp_path / "page.html", reference=number)
        pages.append((tmp_path / "page.html").read_text())
    assert pages[0] != pages[1]
    with pytest.raises(ValueError, match=r"reference must be in \[0, 1\], got 2"):
        write_planes(model, tmp_path / "page.html", reference=2)


def test_densities_are_those_of_all_references(model):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (500, 3))
    found = model.field.densities(points)
    parts = [stack.densities(points) for stack in stacks(model)]
    assert (parts[0] != parts[1]).any()
    np.testing.assert_array_equal(found, np.maximum(*parts))


def test_groups_of_photographs_are_those_around_each_reference():
    eyes = np.array([[0.0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5.1, 0, 0], [0, 0.1, 0], [5, 0.1, 0]])
    found = sorted(group.tolist() for group in groups_of(eyes, 2))
    assert [set(group) >= part for group, part in zip(found, ({0, 1, 4}, {2, 3, 5}), strict=True)]
    assert all(len(group) == 4 for group in found)  # at least so many
    equal = groups_of(np.zeros((3, 3)), 3)
    assert [group.tolist() for group in equal] == [[0, 1, 2]] * 3


def test_refusals(scene):
    mistakes: Any = (
        (r"references must be in \[1, 16\], got 0", {"references": 0}),
        (r"texels must be in \[256, ", {"references": 2, "texels": 200, "planes": 32}),
    )
    for message, given in mistakes:
        with pytest.raises(ValueError, match=message):
            PlanesField(**given)
    few = make_scene(train=2, test=0, size=16, layout="forward")
    with pytest.raises(ValueError, match="references must be at most the number of photographs"):
        fit(few, replace(ONE, references=3), steps=1)
