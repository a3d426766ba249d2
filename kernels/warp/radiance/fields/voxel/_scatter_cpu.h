#include "_bands.h"

// needs WIDTH, RECORD
// Add the records of a ray at every second (or fourth) plane (and line) of the grid. So no two
// threads add to the same node, and a node's sums are in the order of the rays, for any number of
// threads.
void scatter_ray(int ray, int owner, int owners, wp::array_t<float> directions, int basis,
                 int begin, int room, wp::array_t<float> records, wp::array_t<float> d_density,
                 wp::array_t<float> d_color, wp::array_t<wp::uint8> touched) {
#pragma clang fp contract(fast)
    const VoxelBands bands(directions.data + 3 * (size_t)ray, basis);
    const int side = d_density.shape[0];
    const int own_z = owner & 1, own_y = owner >> 1;
    const float* record = records.data + (size_t)RECORD * begin;
    for (int s = 0; s < room; ++s, record += RECORD) {
        const int at = __builtin_bit_cast(int, record[0]);
        const int i = at & 1023, j0 = at >> 10 & 1023, k0 = at >> 20;
        const int far_z = (k0 ^ own_z) & 1;
        const float wz = far_z ? record[3] : 1.0f - record[3];
        const float d_raw = record[4], r = record[5], g = record[6], b = record[7];
        float row[WIDTH];
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < WIDTH; ++k)
            row[k] = r * bands.of[0][k] + g * bands.of[1][k] + b * bands.of[2][k];
        for (int far_y = 0; far_y < 2; ++far_y) {
            if (owners == 4 && ((j0 + far_y) & 1) != own_y) continue;
            const float wyz = wz * (far_y ? record[2] : 1.0f - record[2]);
            const size_t node = ((size_t)(k0 + far_z) * side + (j0 + far_y)) * side + i;
            const float w0 = wyz * (1.0f - record[1]), w1 = wyz * record[1];
            d_density.data[node] += w0 * d_raw;
            d_density.data[node + 1] += w1 * d_raw;
            touched.data[node] = 1;
            touched.data[node + 1] = 1;
            float* to = d_color.data + node * WIDTH;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < WIDTH; ++k) {
                const float near_k = to[k], far_k = to[k + WIDTH], v = row[k];
                to[k] = near_k + w0 * v;
                to[k + WIDTH] = far_k + w1 * v;
            }
        }
    }
}
