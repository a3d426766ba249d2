#include "_meeting_cpu.h"

// needs AXIS
// Points of a row; loops without branches over its pixels.
void intersect_row(int i, wp::array_t<float> places, wp::array_t<wp::uint8> valid,
                   wp::array_t<float> lenses, wp::array_t<float> pose, wp::array_t<float> points) {
    enum { PART = 256 };
    const int width = places.shape[1];
    const bool all = valid.shape[0] != places.shape[0] || valid.shape[1] != width;
    float lens[18], to[12], x[PART], y[PART], z[PART];
    for (int k = 0; k < 18; ++k) lens[k] = lenses.data[k];
    for (int k = 0; k < 12; ++k) to[k] = pose.data[k];
    for (int begin = 0; begin < width; begin += PART) {
        const int count = width - begin < PART ? width - begin : PART;
        const float* place = places.data + (size_t)i * width + begin;
        const unsigned char* known = valid.data + (all ? 0 : (size_t)i * width + begin);
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < count; ++k)
            Meeting::straighten(lens, (float)i, (float)(begin + k), x[k], y[k]);
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < count; ++k)
            z[k] = Meeting::meet(lens + 9, to, AXIS, place[k], x[k], y[k]);
        float* point = points.data + ((size_t)i * width + begin) * 3;
        for (int k = 0; k < count; ++k) {
            const bool lit = (place[k] >= -0.5f) & (all || known[k] != 0) & (z[k] > 0.0f);
            const float depth = lit ? z[k] : __builtin_nanf("");
            point[3 * k] = depth * x[k], point[3 * k + 1] = depth * y[k], point[3 * k + 2] = depth;
        }
    }
}
