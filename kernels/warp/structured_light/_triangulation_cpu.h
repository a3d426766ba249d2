#include "_meeting_cpu.h"

// needs AXIS, NEWTON_STEPS, LENS_STEPS, WIDEST
// Points of a row, by loops without branches over its pixels. After a short step, a pixel keeps its
// value. The loop ends when all pixels do.
void intersect_row(int i, wp::array_t<float> places, wp::array_t<wp::uint8> valid,
                   wp::array_t<float> lenses, wp::array_t<float> pose, wp::array_t<float> points) {
    enum { PART = 256 };
    const int width = places.shape[1];
    const bool all = valid.shape[0] != places.shape[0] || valid.shape[1] != width;
    float lens[18], to[12];
    float wanted[PART], x[PART], y[PART], w[PART], off[PART], depth[PART];
    int goes[PART];
    for (int k = 0; k < 18; ++k) lens[k] = lenses.data[k];
    for (int k = 0; k < 12; ++k) to[k] = pose.data[k];
    const float down = ((float)i - lens[3]) / lens[1];
    for (int begin = 0; begin < width; begin += PART) {
        const int count = width - begin < PART ? width - begin : PART;
        const float* place = places.data + (size_t)i * width + begin;
        const unsigned char* known = valid.data + (all ? 0 : (size_t)i * width + begin);
        for (int k = 0; k < count; ++k) {
            wanted[k] = x[k] = ((float)(begin + k) - lens[2]) / lens[0];
            y[k] = down, goes[k] = 1;
        }
        for (int step = 0, some = 1; step < NEWTON_STEPS && some; ++step) {
            some = 0;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < count; ++k) {
                float u = x[k], v = y[k];
                const int more = Meeting::straighten(lens, wanted[k], down, u, v) & goes[k];
                x[k] = goes[k] ? u : x[k], y[k] = goes[k] ? v : y[k];
                goes[k] = more, some |= more;
            }
        }
#pragma clang loop vectorize(assume_safety)
        for (int k = 0; k < count; ++k) {
            const bool near =
                (x[k] < WIDEST) & (x[k] > -WIDEST) & (y[k] < WIDEST) & (y[k] > -WIDEST);
            x[k] = near ? x[k] : wanted[k], y[k] = near ? y[k] : down;
            wanted[k] = (place[k] - lens[11 + AXIS]) / lens[9 + AXIS];
            w[k] = Meeting(to, x[k], y[k]).begin(to, AXIS, wanted[k]);
            off[k] = depth[k] = 0.0f, goes[k] = 1;
        }
        for (int step = 0, some = 1; step < LENS_STEPS && some; ++step) {
            some = 0;
#pragma clang loop vectorize(assume_safety)
            for (int k = 0; k < count; ++k) {
                float next = w[k], gap, far;
                Meeting(to, x[k], y[k]).meet(lens + 9, to, AXIS, wanted[k], next, gap, far);
                w[k] = goes[k] ? next : w[k], off[k] = goes[k] ? gap : off[k];
                depth[k] = goes[k] ? far : depth[k];
                // A place that is not known has no line, and waits for none.
                const int more = !((gap < STILL) & (gap > -STILL)) & (place[k] >= -0.5f) & goes[k];
                goes[k] = more, some |= more;
            }
        }
        float* point = points.data + ((size_t)i * width + begin) * 3;
        for (int k = 0; k < count; ++k) {
            const float z = Meeting::depth_of(w[k], off[k], depth[k]);
            const bool lit = (place[k] >= -0.5f) & (all || known[k] != 0) & (z > 0.0f);
            const float far = lit ? z : __builtin_nanf("");
            point[3 * k] = far * x[k], point[3 * k + 1] = far * y[k], point[3 * k + 2] = far;
        }
    }
}
