"""Compositing of packed samples along rays on CUDA: a warp a ray, 32 samples at once.

The sums and products of compositing.py over the samples before one are those of the 32
before, carried along, and those of the lanes before, by halves. The arrays are the caller's: they
need not begin where two numbers can be loaded at once.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

THREADS = 32  # of a ray

_RAY = """
    const unsigned all = 0xffffffffu;
    const int lane = threadIdx.x & 31;
    const int begin = spans.data[2 * (size_t)ray], end = begin + spans.data[2 * (size_t)ray + 1];
    auto sum_up_to = [&](float x) {  // of the lanes up to and with this one
        for (int s = 1; s < 32; s *= 2) {
            const float before = __shfl_up_sync(all, x, s);
            x += lane >= s ? before : 0.0f;
        }
        return x;
    };
    auto sum = [&](float x) {
        for (int s = 16; s; s /= 2) x += __shfl_xor_sync(all, x, s);
        return x;
    };
    auto lane_before = [&](float x, float carried) {
        const float before = __shfl_up_sync(all, x, 1);
        return lane ? before : carried;
    };
    float left = 1.0f, sum_w = 0.0f, sum_wt = 0.0f;  // T, and sums of w and w t
"""

# The sample of a lane: lit unless it is behind the end or the stop, and then zeros, even if NaN.
_SAMPLE = """
        const int i = first + lane;
        const bool own = i < end;
        const float* at = distances.data + 2 * (size_t)i;
        const float* from = rgb.data + 3 * (size_t)i;
        float t = own ? at[0] : 0.0f, d = own ? at[1] : 0.0f;
        float red = own ? from[0] : 0.0f, green = own ? from[1] : 0.0f;
        float blue = own ? from[2] : 0.0f;
        const float through = own ? expf(-sigma.data[i] * d) : 1.0f;
        float passed = through;
        for (int s = 1; s < 32; s *= 2) {
            const float before = __shfl_up_sync(all, passed, s);
            passed *= lane >= s ? before : 1.0f;
        }
        const float before = left * lane_before(passed, 1.0f);
        // Products by halves may grow by a rounding: none is lit behind the first that is not.
        const unsigned dark = __ballot_sync(all, !own || !(before > stop));
        const bool lit = !(dark << (31 - lane));
        if (!lit) t = d = red = green = blue = 0.0f;
        const float w = lit ? before * (1.0f - through) : 0.0f;
        const float upto_w = sum_w + sum_up_to(w), upto_wt = sum_wt + sum_up_to(w * t);
        const float before_w = lane_before(upto_w, sum_w);
        const float before_wt = lane_before(upto_wt, sum_wt);
        left *= __shfl_sync(all, passed, 31);
        sum_w = __shfl_sync(all, upto_w, 31);
        sum_wt = __shfl_sync(all, upto_wt, 31);
        const float nearer = t * before_w - before_wt;  // sum of w_j |t_i - t_j| over j < i
"""

_FORWARD = f"""{_RAY}
    float c[3] = {{}}, spread = 0.0f;
    for (int first = begin; first < end; first += 32) {{{_SAMPLE}
        c[0] += w * red;
        c[1] += w * green;
        c[2] += w * blue;
        spread += w * (2.0f * nearer + w * d / 3.0f);
        if (dark) break;
    }}
    for (int k = 0; k < 3; ++k) c[k] = sum(c[k]);
    spread = sum(spread);
    if (lane == 0) {{
        for (int k = 0; k < 3; ++k) color.data[3 * (size_t)ray + k] = c[k];
        opacity.data[ray] = sum_w;
        depth.data[ray] = sum_wt;
        distortion.data[ray] = spread;
    }}
"""

_BACKWARD = f"""{_RAY}
    const float* dc = d_color.data + 3 * (size_t)ray;
    const float dr = dc[0], dg = dc[1], db = dc[2];
    const float d_o = d_opacity.data[ray], d_t = d_depth.data[ray], d_x = d_distortion.data[ray];
    float rest = 0.0f;  // sum of w_j G_j, at first over all samples: of w_j dX/dw_j that is 2 X
    for (int first = begin; first < end; first += 32) {{{_SAMPLE}
        const float g = dr * red + dg * green + db * blue + d_o + d_t * t;
        rest += w * (g + 2.0f * d_x * (2.0f * nearer + w * d / 3.0f));
        if (dark) break;
    }}
    rest = sum(rest);
    const float all_w = sum_w, all_wt = sum_wt;
    left = 1.0f;
    sum_w = sum_wt = 0.0f;
    int first = begin;
    for (bool more = true; more && first < end; first += 32) {{{_SAMPLE}
        const float farther = all_wt - upto_wt - t * (all_w - upto_w);
        float g = dr * red + dg * green + db * blue + d_o + d_t * t;
        g += d_x * (2.0f * (nearer + farther) + 2.0f / 3.0f * w * d);
        const float behind = rest - sum_up_to(w * g);
        rest = __shfl_sync(all, behind, 31);
        if (own) {{
            float* to = d_rgb.data + 3 * (size_t)i;
            d_sigma.data[i] = lit ? d * ((before - w) * g - behind) : 0.0f;
            to[0] = lit ? w * dr : 0.0f;
            to[1] = lit ? w * dg : 0.0f;
            to[2] = lit ? w * db : 0.0f;
        }}
        more = !dark;
    }}
    for (int i = first + lane; i < end; i += 32) {{
        float* to = d_rgb.data + 3 * (size_t)i;
        d_sigma.data[i] = to[0] = to[1] = to[2] = 0.0f;
    }}
"""


@wp.func_native(_FORWARD)
def composite(
    ray: int,
    sigma: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    spans: wp.array2d[int],
    stop: float,
    color: wp.array2d[float],
    opacity: wp.array[float],
    depth: wp.array[float],
    distortion: wp.array[float],
): ...


@wp.func_native(_BACKWARD)
def take_back(
    ray: int,
    d_color: wp.array2d[float],
    d_opacity: wp.array[float],
    d_depth: wp.array[float],
    d_distortion: wp.array[float],
    sigma: wp.array[float],
    rgb: wp.array2d[float],
    distances: wp.array2d[float],
    spans: wp.array2d[int],
    stop: float,
    d_sigma: wp.array[float],
    d_rgb: wp.array2d[float],
): ...


@wp.kernel
def forward(
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    color: wp.array2d[float],  # (R, 3)
    opacity: wp.array[float],  # (R,)
    depth: wp.array[float],  # (R,)
    distortion: wp.array[float],  # (R,)
):
    """Walk along each ray once."""
    ray = wp.tid() // 32
    composite(ray, sigma, rgb, distances, spans, stop, color, opacity, depth, distortion)


@wp.kernel
def backward(
    d_color: wp.array2d[float],  # (R, 3)
    d_opacity: wp.array[float],  # (R,)
    d_depth: wp.array[float],  # (R,)
    d_distortion: wp.array[float],  # (R,)
    sigma: wp.array[float],  # (M,)
    rgb: wp.array2d[float],  # (M, 3)
    distances: wp.array2d[float],  # (M, 2)
    spans: wp.array2d[int],  # (R, 2)
    stop: float,
    # outputs
    d_sigma: wp.array[float],  # (M,)
    d_rgb: wp.array2d[float],  # (M, 3)
):
    """Walk along each ray twice."""
    ray = wp.tid() // 32
    take_back(
        ray, d_color, d_opacity, d_depth, d_distortion, sigma, rgb, distances, spans, stop,
        d_sigma, d_rgb,
    )  # fmt: skip
