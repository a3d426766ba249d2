#include "_walk.cu"

// needs MOST_LOG_DENSITY, Rays, Space, March, Grid
void walk_forward(int ray, float jitter, Rays rays, Space space, March march, Grid grid, float stop,
                  Composited seen, wp::array_t<int> samples) {
    VoxelWalk at(ray, jitter, rays, space, march, grid, stop);
    float out[4] = {0.0f, 0.0f, 0.0f, 0.0f};  // this lane's colour and distortion
    int found = 0;
    while (at.next()) {
        for (int c = 0; c < 3; ++c) out[c] += at.w * at.rgb[c];
        out[3] += at.w * (2.0f * (at.t * at.ahead_w - at.ahead_wt) + at.w * at.gap * (1.0f / 3.0f));
        found += __popc(at.seen);
    }
    for (int c = 0; c < 4; ++c)
        for (int k = 16; k; k /= 2) out[c] += __shfl_xor_sync(0xffffffffu, out[c], k);
    if (at.lane == 0) {
        for (int c = 0; c < 3; ++c) seen.color.data[3 * (size_t)ray + c] = out[c];
        seen.opacity.data[ray] = at.sum_w;
        seen.depth.data[ray] = at.sum_wt;
        seen.distortion.data[ray] = out[3];
        samples.data[ray] = found;
    }
}
