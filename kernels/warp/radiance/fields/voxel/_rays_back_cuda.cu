#include "../../_fixed_point.cu"
#include "_walk.cu"

// needs MOST_LOG_DENSITY, Rays, Space, March, Grid, FIXED, UNIT, LIMIT
// Add to float32 numbers, or, if FIXED, to fixed-point numbers in int64.
void walk_backward(int ray, float jitter, Composited d_seen, Rays rays, Space space, March march,
                   Grid grid, float stop, Composited seen, wp::array_t<Sum> d_density,
                   wp::array_t<Sum> d_color, wp::array_t<wp::uint8> touched) {
    const unsigned all = 0xffffffffu;
    VoxelWalk at(ray, jitter, rays, space, march, grid, stop);
    const int side = grid.density.shape[0], plane = side * side, width = grid.color.shape[3];
    auto add = [](auto* to, float value) {
        if (FIXED)
            FixedPoint::add((wp::int64*)to, value);
        else
            atomicAdd((float*)to, value);
    };
    auto add_four = [&](auto* to, const float4& v) {
#if __CUDA_ARCH__ >= 900
        if (!FIXED) {
            asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};" ::"l"(to), "f"(v.x),
                         "f"(v.y), "f"(v.z), "f"(v.w)
                         : "memory");
            return;
        }
#endif
        add(to, v.x);
        add(to + 1, v.y);
        add(to + 2, v.z);
        add(to + 3, v.w);
    };
    float dc[3];
    for (int c = 0; c < 3; ++c) dc[c] = d_seen.color.data[3 * (size_t)ray + c];
    const float d_o = d_seen.opacity.data[ray], d_t = d_seen.depth.data[ray];
    const float d_x = d_seen.distortion.data[ray];
    const float all_w = seen.opacity.data[ray], all_wt = seen.depth.data[ray];
    float rest = d_o * all_w + d_t * all_wt + 2.0f * d_x * seen.distortion.data[ray];
    for (int c = 0; c < 3; ++c) rest += dc[c] * seen.color.data[3 * (size_t)ray + c];
    while (at.next()) {
        const float after_w = at.ahead_w + at.w, after_wt = at.ahead_wt + at.w * at.t;
        const float apart =
            at.t * at.ahead_w - at.ahead_wt + (all_wt - after_wt) - at.t * (all_w - after_w);
        float g = d_o + d_t * at.t + d_x * (2.0f * apart + (2.0f / 3.0f) * at.w * at.gap);
        for (int c = 0; c < 3; ++c) g += dc[c] * at.rgb[c];
        const float upto = at.sum_up_to(at.w * g);
        const float d_raw = at.sigma * at.gap * (at.behind * g - (rest - upto));
        rest -= __shfl_sync(all, upto, 31);
        float slopes[3];  // gradients by the sums of harmonics
        for (int c = 0; c < 3; ++c) slopes[c] = at.w * dc[c] * at.rgb[c] * (1.0f - at.rgb[c]);
        for (unsigned todo = at.seen & at.own; __any_sync(all, todo); todo &= todo - 1) {
            const int s = __ffs(todo) - 1;  // -1 if none is left
            const int node = __shfl_sync(all, at.node, s);
            const float d_node = __shfl_sync(all, d_raw, s);
            float fs[3], row[4] = {0.0f, 0.0f, 0.0f, 0.0f};
            for (int k = 0; k < 3; ++k) fs[k] = __shfl_sync(all, at.f[k], s);
            for (int c = 0; c < 3; ++c) {
                const float slope = __shfl_sync(all, slopes[c], s);
                for (int k = 0; k < 4; ++k) row[k] += slope * at.bands[c][k];
            }
            if (todo == 0) continue;
            auto node_at = [&](int corner) {
                return node + (corner & 1) + (corner >> 1 & 1) * side + (corner >> 2) * plane;
            };
            auto share = [&](int corner) {
                return (corner & 1 ? fs[0] : 1.0f - fs[0]) * (corner & 2 ? fs[1] : 1.0f - fs[1]) *
                       (corner & 4 ? fs[2] : 1.0f - fs[2]);
            };
            if (4 * at.part < 3 * grid.basis)
                for (int corner = 0; corner < 8; ++corner) {
                    const float b = share(corner);
                    add_four(d_color.data + (size_t)node_at(corner) * width + 4 * at.part,
                             make_float4(b * row[0], b * row[1], b * row[2], b * row[3]));
                }
            for (int corner = at.part; corner < 8; corner += at.each) {
                add(d_density.data + node_at(corner), share(corner) * d_node);
                touched.data[node_at(corner)] = 1;
            }
        }
    }
}
