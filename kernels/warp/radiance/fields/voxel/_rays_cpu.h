#include "_walk.h"

// needs WIDTH, MOST_LOG_DENSITY, Rays, Space, March, Grid
void walk_forward(int ray, float jitter, Rays rays, Space space, March march, Grid grid, float stop,
                  Composited seen, wp::array_t<int> samples) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
    VoxelBands bands(rays.directions.data + 3 * (size_t)ray, grid.basis);
    if (grid.basis == 9) bands.round_as_walks(rays.directions.data + 3 * (size_t)ray);
    VoxelWalk walk(ray, jitter, rays, space, march, grid, stop);
    VoxelBatch batch;
    float out[3] = {0.0f, 0.0f, 0.0f}, sum_w = 0.0f, sum_wt = 0.0f, spread = 0.0f;
    int found = 0;
    while (walk.next(batch, bands))
        for (int s = 0; s < batch.seen; ++s) {
            const float w = batch.weight[s], t = batch.t[s];
            for (int c = 0; c < 3; ++c) out[c] += w * batch.rgb[c][s];
            spread += w * (2.0f * (t * sum_w - sum_wt) + w * batch.gap[s] * (1.0f / 3.0f));
            sum_w += w;
            sum_wt += w * t;
            found += batch.sigma[s] > 0.0f;
        }
    for (int c = 0; c < 3; ++c) seen.color.data[3 * (size_t)ray + c] = out[c];
    seen.opacity.data[ray] = sum_w;
    seen.depth.data[ray] = sum_wt;
    seen.distortion.data[ray] = spread;
    samples.data[ray] = found;
}

// needs WIDTH, MOST_LOG_DENSITY, Rays, Space, March, Grid, RECORD
// Write records of samples, beginning at `begin`, up to the room that there is.
void walk_backward(int ray, float jitter, Composited d_seen, Rays rays, Space space, March march,
                   Grid grid, float stop, Composited seen, int begin, int room,
                   wp::array_t<float> records) {
#pragma clang fp contract(fast)
#pragma clang fp reassociate(on)
    VoxelBands bands(rays.directions.data + 3 * (size_t)ray, grid.basis);
    if (grid.basis == 9) bands.round_as_walks(rays.directions.data + 3 * (size_t)ray);
    VoxelWalk walk(ray, jitter, rays, space, march, grid, stop);
    VoxelBatch batch;
    const float* dc = d_seen.color.data + 3 * (size_t)ray;
    const float d_o = d_seen.opacity.data[ray], d_t = d_seen.depth.data[ray];
    const float d_x = d_seen.distortion.data[ray];
    const float all_w = seen.opacity.data[ray], all_wt = seen.depth.data[ray];
    float rest = d_o * all_w + d_t * all_wt + 2.0f * d_x * seen.distortion.data[ray];
    for (int c = 0; c < 3; ++c) rest += dc[c] * seen.color.data[3 * (size_t)ray + c];
    float sum_w = 0.0f, sum_wt = 0.0f;
    float* record = records.data + (size_t)RECORD * begin;
    float* const end = record + (size_t)RECORD * room;
    while (walk.next(batch, bands))
        for (int s = 0; s < batch.seen; ++s) {
            if (batch.sigma[s] <= 0.0f || record == end) continue;
            const float w = batch.weight[s], u = batch.t[s];
            float apart = u * sum_w - sum_wt;
            sum_w += w;
            sum_wt += w * u;
            apart += (all_wt - sum_wt) - u * (all_w - sum_w);
            float g = d_o + d_t * u + d_x * (2.0f * apart + (2.0f / 3.0f) * w * batch.gap[s]);
            for (int c = 0; c < 3; ++c) g += dc[c] * batch.rgb[c][s];
            rest -= w * g;
            const int at = batch.cells[0][s] | batch.cells[1][s] << 10 | batch.cells[2][s] << 20;
            record[0] = __builtin_bit_cast(float, at);
            for (int k = 0; k < 3; ++k) record[1 + k] = batch.f[k][s];
            record[4] = batch.sigma[s] * batch.gap[s] * (batch.behind[s] * g - rest);
            for (int c = 0; c < 3; ++c)
                record[5 + c] = w * dc[c] * batch.rgb[c][s] * (1.0f - batch.rgb[c][s]);
            record += RECORD;
        }
    // By rounding, the walk may have ended earlier than in the forward pass.
    for (; record < end; ++record) *record = 0.0f;
}
