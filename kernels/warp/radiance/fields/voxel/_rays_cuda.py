"""Rays through a grid of density and colour on CUDA: one warp a ray.

Its threads are 32 places along the ray, empty or not. Those that are not are then taken four (or
eight) at a time: eight (or four) threads read rows of the grid for one, or add to them, each four
coefficients.
"""

from functools import cache
from typing import Any

import warp as wp

from cvkern.kernels.codes.radiance import MOST_LOG_DENSITY
from cvkern.kernels.warp.radiance._fixed_point import ADD_FIXED
from cvkern.kernels.warp.radiance._harmonics import HARMONICS

from ._march import NAMES, March, jitter_of

OPTIONS = {"enable_backward": False}
wp.set_module_options(OPTIONS)

THREADS = 32  # of a ray
BLOCK = 64  # few, as rays differ in length
BOUNDS = BLOCK, 10  # with more blocks at a time there would not be registers enough

# The b-th harmonic, by comparisons: an index would put all of them in memory.
_HARMONIC = "".join(f"b == {k} ? {h} : " for k, h in enumerate(HARMONICS[:8])) + HARMONICS[8]

# BEFORE and AFTER differ between the passes: AFTER has, in each thread, one sample.
_WALK = """
    NAMES
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31, width = color.shape[3];
    const int side = density.shape[0], resolution = side - 1, plane = side * side;
    const int shift = __ffs(resolution / cells) - 1;  // log2 of the side of an occupancy cell
    float o[3], d[3];
    for (int k = 0; k < 3; ++k) {
        o[k] = origins.data[3 * (size_t)ray + k];
        d[k] = directions.data[3 * (size_t)ray + k];
    }
    const int each = width / 4, rows = 32 / each;  // threads of a row, and rows at a time
    const int part = lane & (each - 1), from = (lane & (rows - 1)) * each;
    const unsigned own = all / ((1u << rows) - 1) << lane / each;  // one sample in `rows`
    float bands[3][4];
    for (int k = 0; k < 4; ++k) {
        const float x = d[0], y = d[1], z = d[2];
        const int n = 4 * part + k, b = n % basis;
        const float h = HARMONIC;
        for (int c = 0; c < 3; ++c) bands[c][k] = n / basis == c ? h : 0.0f;
    }
    auto mix = [](const float4& a, const float4& b, float t) {
        return make_float4(
            a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z),
            a.w + t * (b.w - a.w));
    };
    const float scale = (unbounded ? 0.25f : 0.5f) * (float)resolution;
    const float middle = 0.5f * (float)resolution, most = (float)resolution;
    float first = near, last = far;
    if (!unbounded)
        for (int k = 0; k < 3; ++k) {
            const float inverse = 1.0f / (fabsf(d[k]) < 1e-12f ? copysignf(1e-12f, d[k]) : d[k]);
            const float a = (-1.0f - o[k]) * inverse, b = (1.0f - o[k]) * inverse;
            first = fmaxf(first, fminf(a, b));
            last = fminf(last, fmaxf(a, b));
        }
    first += jitter * fmaxf(finest, cone * first);
    float left = 1.0f, sum_w = 0.0f, sum_wt = 0.0f;
    BEFORE
    while (first < last && left > stop) {
        float t = first + (float)lane * finest;
        float gap = finest;
        if (cone > 0.0f) {
            t = first;
            gap = fmaxf(finest, cone * t);
            for (int s = 0; s < lane; ++s) {
                t += gap;
                gap = fmaxf(finest, cone * t);
            }
        }
        first = __shfl_sync(all, t + gap, 31);
        float y[3] = {o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]};
        if (unbounded) {
            const float square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
            if (square > 1.0f) {
                const float r = rsqrtf(square), shrink = (2.0f - r) * r;
                for (int k = 0; k < 3; ++k) y[k] *= shrink;
            }
        }
        int i[3];
        float f[3];
        for (int k = 0; k < 3; ++k) {
            const float g = fminf(fmaxf(y[k] * scale + middle, 0.0f), most);
            i[k] = min((int)g, resolution - 1);
            f[k] = g - (float)i[k];
        }
        const int node = (i[2] * side + i[1]) * side + i[0];
        const int cell = ((i[2] >> shift) * cells + (i[1] >> shift)) * cells + (i[0] >> shift);
        float raw = -1e30f;
        if (t < last && (bits.data[cell >> 5] >> (cell & 31) & 1u)) {
            const float* at = density.data + node;
            const float a = at[0] + f[0] * (at[1] - at[0]);
            const float b = at[side] + f[0] * (at[side + 1] - at[side]);
            const float c = at[plane] + f[0] * (at[plane + 1] - at[plane]);
            const float e = at[plane + side] + f[0] * (at[plane + side + 1] - at[plane + side]);
            const float g = a + f[1] * (b - a), h = c + f[1] * (e - c);
            raw = g + f[2] * (h - g);
        }
        if (!__any_sync(all, raw > least)) continue;
        const float sigma = raw > least ? expf(fminf(raw, MOST_LOG_DENSITY)) : 0.0f;
        const float alpha = 1.0f - expf(-sigma * gap);
        float through = 1.0f - alpha;  // up to and with this sample
        for (int s = 1; s < 32; s *= 2) {
            const float before = __shfl_up_sync(all, through, s);
            through *= lane >= s ? before : 1.0f;
        }
        float before = __shfl_up_sync(all, through, 1);
        before = left * (lane ? before : 1.0f);
        const bool lit = raw > least && before > stop;
        const float w = lit ? before * alpha : 0.0f, behind = before - w;
        left *= __shfl_sync(all, through, 31);
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const unsigned seen = __ballot_sync(all, lit);
        for (unsigned todo = seen & own; __any_sync(all, todo); todo &= todo - 1) {
            const int s = __ffs(todo) - 1;  // -1 where no more are left
            const int at = __shfl_sync(all, node, s);
            const float x = __shfl_sync(all, f[0], s), y = __shfl_sync(all, f[1], s);
            const float z = __shfl_sync(all, f[2], s);
            float sums[3] = {0.0f, 0.0f, 0.0f};
            if (todo) {
                const float4* row = (const float4*)color.data + (size_t)at * each + part;
                const int up = side * each, in = plane * each;
                const float4 v0 = row[0], v1 = row[each], v2 = row[up], v3 = row[up + each];
                row += in;
                const float4 v4 = row[0], v5 = row[each], v6 = row[up], v7 = row[up + each];
                const float4 g = mix(mix(v0, v1, x), mix(v2, v3, x), y);
                const float4 h = mix(mix(v4, v5, x), mix(v6, v7, x), y);
                const float4 v = mix(g, h, z);
                for (int c = 0; c < 3; ++c)
                    sums[c] = v.x * bands[c][0] + v.y * bands[c][1] + v.z * bands[c][2]
                        + v.w * bands[c][3];
            }
            for (int k = 4; k; k /= 2)
                for (int c = 0; c < 3; ++c) {
                    const float more = __shfl_xor_sync(all, sums[c], k);
                    sums[c] += k < each ? more : 0.0f;
                }
            // From the threads that take a sample, the first of which is `from`, to its own.
            const bool done = __shfl_sync(all, s, from) == lane;
            for (int c = 0; c < 3; ++c) {
                const float sum = __shfl_sync(all, sums[c], from);
                rgb[c] = done ? sum : rgb[c];
            }
        }
        for (int c = 0; c < 3; ++c) rgb[c] = 1.0f / (1.0f + expf(-rgb[c]));
        // Sums of w and w t up to and with this sample.
        float upto_w = w, upto_wt = w * t;
        for (int s = 1; s < 32; s *= 2) {
            const float a = __shfl_up_sync(all, upto_w, s), b = __shfl_up_sync(all, upto_wt, s);
            upto_w += lane >= s ? a : 0.0f;
            upto_wt += lane >= s ? b : 0.0f;
        }
        const float ahead_w = sum_w + upto_w - w, ahead_wt = sum_wt + upto_wt - w * t;
        sum_w += __shfl_sync(all, upto_w, 31);
        sum_wt += __shfl_sync(all, upto_wt, 31);
        AFTER
    }
    END
"""

_FORWARD = {
    "BEFORE": """
    float out[4] = {0.0f, 0.0f, 0.0f, 0.0f};  // of this thread's samples: colour, distortion
    int found = 0;
    """,
    "AFTER": """
        for (int c = 0; c < 3; ++c) out[c] += w * rgb[c];
        out[3] += w * (2.0f * (t * ahead_w - ahead_wt) + w * gap * (1.0f / 3.0f));
        found += __popc(seen);
    """,
    "END": """
    for (int c = 0; c < 4; ++c)
        for (int k = 16; k; k /= 2) out[c] += __shfl_xor_sync(all, out[c], k);
    if (lane == 0) {
        for (int c = 0; c < 3; ++c) colors.data[3 * (size_t)ray + c] = out[c];
        opacity.data[ray] = sum_w;
        depth.data[ray] = sum_wt;
        distortion.data[ray] = out[3];
        samples.data[ray] = found;
    }
    """,
}

# ADD_ONE is how a `value` is added to the number at `to`, ADD_FOUR how four, `v`, are.
_BACKWARD = {
    "BEFORE": """
    auto add = [](auto* to, float value) { ADD_ONE };
    auto add_four = [&](auto* to, const float4& v) { ADD_FOUR };
    float dc[3];
    for (int c = 0; c < 3; ++c) dc[c] = d_colors.data[3 * (size_t)ray + c];
    const float d_o = d_opacity.data[ray], d_t = d_depth.data[ray], d_x = d_distortion.data[ray];
    const float all_w = opacity.data[ray], all_wt = depth.data[ray];
    float rest = d_o * all_w + d_t * all_wt + 2.0f * d_x * distortion.data[ray];
    for (int c = 0; c < 3; ++c) rest += dc[c] * colors.data[3 * (size_t)ray + c];
    """,
    "AFTER": """
        const float after_w = ahead_w + w, after_wt = ahead_wt + w * t;
        const float apart =
            t * ahead_w - ahead_wt + (all_wt - after_wt) - t * (all_w - after_w);
        float g = d_o + d_t * t + d_x * (2.0f * apart + (2.0f / 3.0f) * w * gap);
        for (int c = 0; c < 3; ++c) g += dc[c] * rgb[c];
        float upto = w * g;
        for (int s = 1; s < 32; s *= 2) {
            const float a = __shfl_up_sync(all, upto, s);
            upto += lane >= s ? a : 0.0f;
        }
        const float d_raw = sigma * gap * (behind * g - (rest - upto));
        rest -= __shfl_sync(all, upto, 31);
        float slopes[3];  // by the sums of harmonics
        for (int c = 0; c < 3; ++c) slopes[c] = w * dc[c] * rgb[c] * (1.0f - rgb[c]);
        for (unsigned todo = seen & own; __any_sync(all, todo); todo &= todo - 1) {
            const int s = __ffs(todo) - 1;  // -1 where no more are left
            const int at = __shfl_sync(all, node, s);
            const float d_node = __shfl_sync(all, d_raw, s);
            float fs[3], row[4] = {0.0f, 0.0f, 0.0f, 0.0f};
            for (int k = 0; k < 3; ++k) fs[k] = __shfl_sync(all, f[k], s);
            for (int c = 0; c < 3; ++c) {
                const float slope = __shfl_sync(all, slopes[c], s);
                for (int k = 0; k < 4; ++k) row[k] += slope * bands[c][k];
            }
            if (todo == 0) continue;
            auto node_at = [&](int corner) {
                return at + (corner & 1) + (corner >> 1 & 1) * side + (corner >> 2) * plane;
            };
            auto share = [&](int corner) {
                return (corner & 1 ? fs[0] : 1.0f - fs[0]) * (corner & 2 ? fs[1] : 1.0f - fs[1])
                    * (corner & 4 ? fs[2] : 1.0f - fs[2]);
            };
            if (4 * part < 3 * basis)
                for (int corner = 0; corner < 8; ++corner) {
                    const float b = share(corner);
                    add_four(
                        d_color.data + (size_t)node_at(corner) * width + 4 * part,
                        make_float4(b * row[0], b * row[1], b * row[2], b * row[3]));
                }
            for (int corner = part; corner < 8; corner += each) {
                add(d_density.data + node_at(corner), share(corner) * d_node);
                touched.data[node_at(corner)] = 1;
            }
        }
    """,
    "END": "",
}

_ADD_EACH = "add(to, v.x); add(to + 1, v.y); add(to + 2, v.z); add(to + 3, v.w);"
_ADD_FOUR = f"""
#if __CUDA_ARCH__ >= 900
    asm volatile("red.global.add.v4.f32 [%0], {{%1, %2, %3, %4}};"
        ::"l"(to), "f"(v.x), "f"(v.y), "f"(v.z), "f"(v.w) : "memory");
#else
    {_ADD_EACH}
#endif
"""

_ADD = {
    wp.float32: {"ADD_ONE": "atomicAdd(to, value);", "ADD_FOUR": _ADD_FOUR},
    wp.int64: {"ADD_ONE": ADD_FIXED, "ADD_FOUR": _ADD_EACH},
}


def _text(parts: dict[str, str]) -> str:
    text = _WALK
    shared = {
        "NAMES": NAMES, "HARMONIC": _HARMONIC, "MOST_LOG_DENSITY": f"{MOST_LOG_DENSITY}f"
    }  # fmt: skip
    for name, part in (parts | shared).items():
        text = text.replace(name, part)
    return text


@wp.func_native("return blockIdx.x * (blockDim.x / 32) + threadIdx.x / 32;")
def warp_number() -> int:
    """Return what `wp.tid() // 32` is, in fewer instructions."""
    ...


@wp.func_native(_text(_FORWARD))
def walk_forward(
    ray: int,
    jitter: float,
    origins: wp.array2d[float],
    directions: wp.array2d[float],
    march: March,
    colors: wp.array2d[float],
    opacity: wp.array[float],
    depth: wp.array[float],
    distortion: wp.array[float],
    samples: wp.array[int],
): ...


@wp.kernel(launch_bounds=BOUNDS)
def render(
    origins: wp.array2d[float],  # (R, 3)
    directions: wp.array2d[float],  # (R, 3)
    active: wp.array[int],  # (1,)
    march: March,
    # outputs
    colors: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    depth: wp.array[float],  # (R,)
    distortion: wp.array[float],  # (R,)
    samples: wp.array[int],  # (R,)
):
    ray = warp_number()
    if ray < active[0]:
        walk_forward(
            ray, jitter_of(march, ray), origins, directions, march, colors, opacity, depth,
            distortion, samples,
        )  # fmt: skip
    else:
        samples[ray] = 0


@cache
def render_backward(sums: Any) -> wp.Kernel:
    """Return the kernel that adds to float32, or to int64 of fixed-point numbers."""

    @wp.func_native(_text(_BACKWARD | _ADD[sums]))
    def walk_backward(
        ray: int,
        jitter: float,
        d_colors: wp.array2d[float],
        d_opacity: wp.array[float],
        d_depth: wp.array[float],
        d_distortion: wp.array[float],
        origins: wp.array2d[float],
        directions: wp.array2d[float],
        march: March,
        colors: wp.array2d[float],
        opacity: wp.array[float],
        depth: wp.array[float],
        distortion: wp.array[float],
        d_density: wp.array3d[sums],
        d_color: wp.array4d[sums],
        touched: wp.array3d[wp.uint8],
    ): ...

    @wp.kernel(launch_bounds=BOUNDS, module="unique", module_options=OPTIONS)
    def render_backward(
        d_colors: wp.array2d[float],  # (R, 3)
        d_opacity: wp.array[float],  # (R,)
        d_depth: wp.array[float],  # (R,)
        d_distortion: wp.array[float],  # (R,)
        origins: wp.array2d[float],  # (R, 3)
        directions: wp.array2d[float],  # (R, 3)
        active: wp.array[int],  # (1,)
        march: March,
        colors: wp.array2d[float],  # (R, 3)
        opacity: wp.array[float],  # (R,)
        depth: wp.array[float],  # (R,)
        distortion: wp.array[float],  # (R,)
        samples: wp.array[int],  # (R,)
        # outputs
        d_density: wp.array3d[sums],  # added to
        d_color: wp.array4d[sums],  # added to
        touched: wp.array3d[wp.uint8],
    ):
        ray = warp_number()
        if ray < active[0]:
            if samples[ray] > 0:
                walk_backward(
                    ray, jitter_of(march, ray), d_colors, d_opacity, d_depth, d_distortion, origins,
                    directions, march, colors, opacity, depth, distortion, d_density, d_color,
                    touched,
                )  # fmt: skip

    return render_backward
