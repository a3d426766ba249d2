"""Views of fields in rounds: the rounds, the final steps, and whole fields with little room."""

import numpy as np
import pytest

from cvkern._runtime import runtime
from cvkern.kernels.codes import radiance as codes
from cvkern.radiance import HashField, VoxelField
from cvkern.radiance.fields.field import Frame, View
from cvkern.radiance.fields.hash import HashNetwork
from cvkern.radiance.scenes.photographs import Bounds
from tests.radiance import reference_radiance as reference
from tests.radiance.march.test_steps import SPACES, Space, blobs, bundle, march, pack

F32, I32 = np.float32, np.int32
EVERYWHERE = Space(1, 16, 1e9, 0.011, 0.0, False)


def field(positions, thick):
    """Return the density and the colours of a field: by products and sums, the same in any row."""
    x, y, z = positions.astype(F32).T
    wave = (F32(9) * x + F32(5) * y + F32(7) * z) % F32(1)
    return F32(2 * thick) * wave, (F32(6) * positions.astype(F32)) % F32(1)


class Views:
    """What rays see in rounds of `few` samples a ray, and which samples they took for it."""

    def __init__(self, kernels, origins, directions, occupied, space, few, *, thick=3.0, stop=1e-4,
                 most=10**6, near=0.05):  # fmt: skip
        levels, cells, far, finest, cone, unbounded = space
        count, bits = len(origins), pack(occupied)
        marched = (
            codes.Rays(origins, directions, np.array([0], I32)),
            codes.Space(bits, levels, cells, unbounded),
            codes.March(near, far, finest, cone, most, False, 0, np.array([0], I32)),
        )
        views = (
            ((count,), F32),
            ((count,), I32),
            ((count, 3), F32),
            ((count,), F32),
            ((count,), F32),
        )
        listing, counts, at, taken, *seen = kernels(
            "radiance.rendering.set_out", *marched,
            out=[((count,), I32), ((2,), I32), codes.Views(*views)],
        )  # fmt: skip
        self.taken, self.rounds, living = [[] for _ in range(count)], [], count
        while living:
            room = few * living
            at, taken, *seen, going, spans, counts, positions, distances, rays = kernels(
                "radiance.rendering.march_on",
                *marched,
                few,
                living,
                listing,
                out=[
                    codes.Views(at, taken, *seen),
                    ((count,), I32),
                    ((count, 2), I32),
                    counts,
                    codes.Samples(((room, 3), F32), ((room, 2), F32), ((room,), I32)),
                ],
            )
            total, living = counts
            self.rounds.append((total, living))
            owners = np.full(total, -1)
            for ray, (begin, number) in zip(going[:living], spans[:living], strict=True):
                assert 1 <= number <= few
                assert (owners[begin : begin + number] == -1).all()  # rows of its own
                owners[begin : begin + number] = ray
                self.taken[ray] += distances[begin : begin + number].tolist()
            np.testing.assert_array_equal(rays[:total], owners)
            assert len(set(going[:living])) == living
            if living:
                sigma, rgb = field(positions, thick)
                counts, at, _, *seen = kernels(
                    "radiance.rendering.composite_on",
                    sigma,
                    rgb,
                    distances,
                    going,
                    spans,
                    int(living),
                    stop,
                    out=[counts, codes.Views(at, taken, *seen)],
                )
            listing, living = going, int(living)
        self.numbers, self.seen = taken, seen


@pytest.mark.parametrize("share", [0.1, 0.6])
@pytest.mark.parametrize("space", SPACES)
def test_rounds_are_what_one_look_is(kernels, space, share):
    space = SPACES[space]
    levels, cells = space[:2]
    origins, directions = bundle(80)
    occupied = blobs(levels, cells, share)
    whole = Views(kernels, origins, directions, occupied, space, 10**4, stop=0.0, thick=0.5)
    # With light left everywhere, the samples are those of training, but for the jitter.
    _, spans, total, positions, distances, _ = march(
        kernels, origins, directions, occupied, space, jittered=False, room=200000
    )
    assert total[0] == spans[:, 1].sum() == whole.numbers.sum()
    for (begin, number), taken in zip(spans, whole.taken, strict=True):
        np.testing.assert_array_equal(np.reshape(taken, (-1, 2)), distances[begin : begin + number])
    sigma, rgb = field(positions, 0.5)
    wanted = reference.composite(sigma, rgb, distances, spans, 0.0)[:3]
    for got, want in zip(whole.seen, wanted, strict=True):
        # Sums of hundreds of terms in float32, of distances of up to 100.
        np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-5)

    for few in (1, 3):
        rounds = Views(kernels, origins, directions, occupied, space, few, stop=0.0, thick=0.5)
        assert rounds.taken == whole.taken
        for got, want in zip(rounds.seen, whole.seen, strict=True):
            np.testing.assert_array_equal(got, want)  # the same sums in the same order


def test_rays_end_where_they_are_opaque(kernels):
    origins, directions = bundle(300)
    occupied = np.ones(16**3, bool)
    given = origins, directions, occupied, EVERYWHERE
    whole = Views(kernels, *given, 10**4, thick=40.0)
    rounds = Views(kernels, *given, 4, thick=40.0)
    for got, want in zip(rounds.seen, whole.seen, strict=True):
        np.testing.assert_array_equal(got, want)
    opaque = rounds.seen[1] >= 1 - 1e-4
    assert 50 < opaque.sum() < 300
    assert (rounds.numbers <= whole.numbers).all()
    assert (rounds.numbers[opaque] < whole.numbers[opaque]).mean() > 0.5
    for ray in np.flatnonzero(opaque):
        taken = np.array(rounds.taken[ray])
        sigma = field(origins[ray] / 2 + taken[:, :1] * directions[ray] / 2 + 0.5, 40.0)[0]
        behind = np.exp(-np.cumsum(sigma * taken[:, 1])) < 0.9e-4
        assert behind.sum() <= 4  # none but the last round's


def test_an_opaque_first_sample_is_all_that_is_seen(kernels):
    origins, directions = bundle(40)
    views = Views(
        kernels, origins, directions, np.ones(16**3, bool), EVERYWHERE, 1, thick=1e9, stop=0.1
    )
    hit = views.numbers > 0
    assert 0 < hit.sum() < 40
    assert set(views.numbers.tolist()) == {0, 1}
    # Except for the sliver of the waves where the density is next to nothing.
    np.testing.assert_array_equal(views.seen[1], hit)
    first = np.array([t[0][0] if t else 0 for t in views.taken], F32)
    np.testing.assert_array_equal(views.seen[2], first)


def test_rounds_take_so_many_samples_at_most(kernels):
    origins, directions = bundle(100)
    given = kernels, origins, directions, np.ones(16**3, bool), EVERYWHERE
    views = Views(*given, 7, most=20, thick=0.0)
    whole = Views(*given, 10**4, thick=0.0)
    np.testing.assert_array_equal(views.numbers, np.minimum(whole.numbers, 20))
    for few, all_ in zip(views.taken, whole.taken, strict=True):
        assert few == all_[:20]


@pytest.mark.parametrize("rays", [1, 31, 33, 1000])
def test_rays_that_miss(kernels, rays):
    origins = np.full((rays, 3), 3, F32)
    directions = np.full((rays, 3), 3**-0.5, F32)
    views = Views(kernels, origins, directions, np.ones(16**3, bool), EVERYWHERE, 4)
    assert views.rounds == [(0, 0)]
    assert not any(part.any() for part in views.seen)
    directions[rays // 2] *= -1  # one goes the other way
    views = Views(kernels, origins, directions, np.ones(16**3, bool), EVERYWHERE, 4)
    assert views.rounds[0] == (4, 1)
    np.testing.assert_array_equal(views.seen[1] > 0, np.arange(rays) == rays // 2)


def test_pictures_are_finished(kernels):
    rng = np.random.default_rng(0)
    opacity = rng.uniform(0, 1, 1000).astype(F32)
    opacity[:3] = 0, 0.5, np.nextafter(F32(0.5), F32(0))
    color = rng.uniform(-0.2, 1.2, (1000, 3)).astype(F32) * opacity[:, None]
    depth = (5 * opacity).astype(F32)
    behind = 0.25, 0.5, 1.0
    seen = kernels("radiance.rendering.finish", *behind, 2.0, 0.5, out=[color, opacity, depth])
    want = (color + (1 - opacity.astype(float))[:, None] * behind).clip(0, 1)
    np.testing.assert_allclose(seen[0], want, rtol=0, atol=2**-22)  # two roundings at 1
    assert seen[0].min() == 0
    assert seen[0].max() == 1
    np.testing.assert_array_equal(seen[1], opacity)
    np.testing.assert_array_equal(np.isnan(seen[2]), opacity < 0.5)
    np.testing.assert_allclose(seen[2][opacity >= 0.5], 10, rtol=2**-21)


# ------------------------------------------------------------------------------------ whole fields


def rays_from_outside(count):
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(count, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    towards = rng.uniform(-0.8, 0.8, (count, 3)) - origins
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return origins.astype(F32), directions.astype(F32)


def see(rt, made, origins, directions):
    count = len(origins)
    seen = View(rt.zeros((count, 3)), rt.zeros((count,)), rt.zeros((count,)))
    made.see(rt.adopt(origins), rt.adopt(directions), seen)
    return [rt.to_numpy(part).copy() for part in seen]


@pytest.mark.parametrize("unbounded", [False, True])
def test_a_field_with_little_room_sees_the_same(backend, unbounded, monkeypatch):
    rt, frame = runtime(), Frame(Bounds((0, 0, 0), 1.0, unbounded), 0.1, 10.0)
    settings = HashField(levels=8, table_bits=10, finest=64, samples=2**14, rays=64, cells=16)
    wide = settings.build(rt, frame, 0)
    narrow = settings.build(rt, frame, 0)
    state = wide.state()
    rng = np.random.default_rng(1)
    state["table.values"] = 3 * rng.normal(size=state["table.values"].shape).astype(F32)
    state["occupancy.bits"] = pack(rng.random(wide.levels * 16**3) < 0.3)
    for made in (wide, narrow):
        made.restore(state)
    rays = rays_from_outside(230)
    want = see(rt, wide, *rays)
    assert 0.2 < want[1].mean() < 0.99
    monkeypatch.setattr(HashNetwork, "view_room", lambda *_: 100)  # less than there are rays
    for got, whole in zip(see(rt, narrow, *rays), want, strict=True):
        np.testing.assert_array_equal(got, whole)  # the same sums in the same order
    one = see(rt, narrow, rays[0][7:8], rays[1][7:8])
    for got, whole in zip(one, want, strict=True):
        np.testing.assert_array_equal(got[0], whole[7])


def test_a_voxel_field_sees_the_same_whatever_the_number_of_rays(backend):
    rt, frame = runtime(), Frame(Bounds((0, 0, 0), 1.0, False), 0.1, 10.0)
    made = VoxelField(resolutions=(16,), shares=(), rays=32).build(rt, frame, 0)
    rng = np.random.default_rng(1)
    rt.write(made.density, rng.normal(size=made.density.shape).astype(F32))
    rt.write(made.color, rng.normal(size=made.color.shape).astype(F32))
    rays = rays_from_outside(230)
    want = see(rt, made, *rays)
    assert 0.2 < want[1].mean() < 0.99
    for part in (slice(0, 1), slice(5, 100), slice(100, 230)):
        for got, whole in zip(see(rt, made, *(a[part] for a in rays)), want, strict=True):
            np.testing.assert_array_equal(got, whole[part])
