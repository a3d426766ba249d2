#include "_triangulation.h"

// needs NEWTON_STEPS, WIDEST, LENS_STEPS, NEAR, STOPS, STILL, AXIS, RUN
// The points of RUN neighbouring pixels of a row: the first needs several steps of Newton's method,
// the next ones begin where their neighbours ended and mostly need one.
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
    float ray[2] = {0.0f, 0.0f}, line[1] = {0.0f}, lens[18], to[12];
#pragma unroll
    for (int k = 0; k < 18; ++k) lens[k] = lenses.data[k];
#pragma unroll
    for (int k = 0; k < 12; ++k) to[k] = pose.data[k];
    for (int k = 0; k < RUN && j + k < width; k += 4) {
        float place[4], point[12];
        bool known[4];
        if (whole) {
            const float4 four = *(const float4*)(places.data + here + k);
            const uchar4 some =
                all ? make_uchar4(1, 1, 1, 1) : *(const uchar4*)(valid.data + here + k);
            place[0] = four.x, place[1] = four.y, place[2] = four.z, place[3] = four.w;
            known[0] = some.x, known[1] = some.y, known[2] = some.z, known[3] = some.w;
        } else {
            for (int n = 0; n < 4; ++n) {
                const bool inside = j + k + n < width;
                place[n] = inside ? places.data[here + k + n] : -1.0f;
                known[n] = inside && (all || valid.data[here + k + n]);
            }
        }
#pragma unroll
        for (int n = 0; n < 4; ++n) {
            float x, y, depth = 0.0f;
            Light::straighten(lens, (float)i, (float)(j + k + n), ray, x, y);
            if (place[n] >= -0.5f && known[n])
                depth = Light::meet(lens + 9, to, AXIS, place[n], line, x, y);
            depth = depth > 0.0f ? depth : __int_as_float(0x7fc00000);
            point[3 * n] = depth * x, point[3 * n + 1] = depth * y, point[3 * n + 2] = depth;
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
