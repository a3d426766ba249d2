#include "_meeting_cuda.h"

// needs RUN
// The points of RUN neighbouring pixels of a row, four at once. The first pixel alone needs several
// steps of Newton's method; four begin where the one before them ended, and mostly need one.
void intersect_run(wp::array_t<float> places, wp::array_t<wp::uint8> valid,
                   wp::array_t<float> lenses, wp::array_t<float> pose, wp::array_t<float> points) {
    const int width = places.shape[1], runs = (width + RUN - 1) / RUN;
    const unsigned item = blockIdx.x * blockDim.x + threadIdx.x;
    if (item >= (unsigned)(places.shape[0] * runs)) return;
    const int i = (int)(item / runs), j = (int)(item - i * runs) * RUN;
    const bool all = valid.shape[0] != places.shape[0] || valid.shape[1] != width;
    const size_t here = (size_t)i * width + j;
    // Four pixels are read and written at once where all are aligned.
    const bool whole = width % 4 == 0 && (size_t)places.data % 16 == 0 &&
                       (size_t)points.data % 16 == 0 && (size_t)valid.data % 4 == 0;
    float place[RUN];
    bool known[RUN];
#pragma unroll
    for (int k = 0; k < RUN; k += 4) {
        if (whole && j + k < width) {
            const float4 four = *(const float4*)(places.data + here + k);
            const uchar4 some =
                all ? make_uchar4(1, 1, 1, 1) : *(const uchar4*)(valid.data + here + k);
            place[k] = four.x, place[k + 1] = four.y, place[k + 2] = four.z, place[k + 3] = four.w;
            known[k] = some.x, known[k + 1] = some.y, known[k + 2] = some.z, known[k + 3] = some.w;
        } else {
            for (int n = k; n < k + 4; ++n) {
                const bool inside = j + n < width;
                place[n] = inside ? places.data[here + n] : -1.0f;
                known[n] = inside && (all || valid.data[here + n]);
            }
        }
    }
    const Meeting light(lenses.data, pose.data);
    const float height = light.down((float)i), middle = light.across((float)j);
    float ray[2] = {middle, height}, line = 0.0f, first;
#pragma unroll
    for (int k = 0; k < RUN; ++k) known[k] = known[k] && place[k] >= -0.5f;
    light.straighten(1, &middle, height, ray, ray + 1);
    if (known[0]) light.meet(1, ray, ray + 1, place, known, line, &first);
    ray[0] -= middle, ray[1] -= height;
#pragma unroll
    for (int k = 0; k < RUN; k += 4) {
        if (j + k >= width) break;
        float wanted[4], x[4], y[4], depth[4], point[12];
#pragma unroll
        for (int n = 0; n < 4; ++n) {
            wanted[n] = light.across((float)(j + k + n));
            x[n] = wanted[n] + ray[0], y[n] = height + ray[1];
        }
        light.straighten(4, wanted, height, x, y);
        ray[0] = x[3] - wanted[3], ray[1] = y[3] - height;
        light.meet(4, x, y, place + k, known + k, line, depth);
#pragma unroll
        for (int n = 0; n < 4; ++n) {
            const float z = depth[n] > 0.0f ? depth[n] : __int_as_float(0x7fc00000);
            point[3 * n] = z * x[n], point[3 * n + 1] = z * y[n], point[3 * n + 2] = z;
        }
        float* out = points.data + 3 * (here + k);
        if (whole) {
#pragma unroll
            for (int n = 0; n < 12; n += 4)
                *(float4*)(out + n) =
                    make_float4(point[n], point[n + 1], point[n + 2], point[n + 3]);
        } else {
            for (int n = 0; n < 12 && j + k + n / 3 < width; ++n) out[n] = point[n];
        }
    }
}
