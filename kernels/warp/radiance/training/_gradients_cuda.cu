#include "../_fixed_point.cu"

// needs UNIT, LIMIT
// Add the sums of four numbers, or of one of the remaining ones.
void collect_some(int thread, wp::array_t<wp::int64> sums, wp::array_t<float> gradients) {
    const int quads = gradients.shape[0] / 4;
    if (thread < quads) {
        longlong2* four = (longlong2*)sums.data + 2 * (size_t)thread;
        const longlong2 a = four[0], b = four[1];
        if (a.x | a.y | b.x | b.y) {
            four[0] = four[1] = make_longlong2(0, 0);
            float4 g = ((float4*)gradients.data)[thread];
            g.x += FixedPoint::fraction(a.x);
            g.y += FixedPoint::fraction(a.y);
            g.z += FixedPoint::fraction(b.x);
            g.w += FixedPoint::fraction(b.y);
            ((float4*)gradients.data)[thread] = g;
        }
    } else {
        const int i = 3 * quads + thread;
        gradients.data[i] += FixedPoint::fraction(sums.data[i]);
        sums.data[i] = 0;
    }
}
