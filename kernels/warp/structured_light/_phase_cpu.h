// Phases of shifted fringes on the CPU: a row at a time, PART pixels at once, so that loops become
// vector code. taichi/structured_light/phase.py has the equations.

#include "../_angles.h"

// needs TYPE, TURN
void decode_row(int row, wp::array_t<TYPE> frames, int begin, wp::array_t<float> frequencies,
                wp::array_t<float> waves, int size, float threshold, bool joins,
                wp::array_t<float> places, wp::array_t<float> phases,
                wp::array_t<float> modulations, wp::array_t<wp::uint8> valid) {
#pragma clang fp contract(off)
    enum { PART = 256 };
    const int width = places.shape[1], steps = waves.shape[0];
    const size_t plane = (size_t)places.shape[0] * width;
    float s[PART], c[PART], place[PART], angle[PART], least[PART];
    for (int left = 0; left < width; left += PART) {
        const int count = width - left < PART ? width - left : PART;
        const size_t here = (size_t)row * width + left;
        const TYPE* from = frames.data + begin * plane + here;
        for (int i = 0; i < count; ++i) {
            place[i] = 0.0f;
            least[i] = __builtin_inff();
        }
        for (int j = 0; j < frequencies.shape[0]; ++j) {
            for (int i = 0; i < count; ++i) s[i] = c[i] = 0.0f;
            for (int n = 0; n < steps; ++n, from += plane) {
                const float sine = waves.data[2 * n], cosine = waves.data[2 * n + 1];
#pragma clang loop vectorize(assume_safety)
                for (int i = 0; i < count; ++i) {
                    const float value = (float)from[i];
                    s[i] += value * sine;
                    c[i] += value * cosine;
                }
            }
            const float f = frequencies.data[j], number = (float)steps;
            const bool first = j == 0;
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < count; ++i) {
                const float r = Alike::angle(s[i], c[i]);
                angle[i] = r;
                const float length = __builtin_sqrtf(c[i] * c[i] + s[i] * s[i]);
                const float bounded = length < __builtin_inff() ? length : __builtin_nanf("");
                const float modulation = 2.0f * bounded / number;
                // NaN stays.
                least[i] = least[i] != least[i] || least[i] <= modulation ? least[i] : modulation;
                const float p = r * TURN;
                const float near = __builtin_floorf(f * place[i] - p + 0.5f);
                const float k = first ? (p < 0.0f ? 1.0f : 0.0f) : near;
                place[i] = (p + k) / f;
            }
        }
        const float whole = (float)size, lowest = frequencies.data[0];
        const unsigned char always = !joins;
        for (int i = 0; i < count; ++i) {
            // Noise may have moved a place across the end of the first period.
            const float u = lowest * place[i];
            place[i] = (u - __builtin_floorf(u)) / lowest;
            const bool seen = least[i] < __builtin_inff();
            places.data[here + i] = seen ? place[i] * whole - 0.5f : __builtin_nanf("");
            phases.data[here + i] = seen ? angle[i] : __builtin_nanf("");
            modulations.data[here + i] = seen ? least[i] : __builtin_nanf("");
            const unsigned char before = valid.data[here + i] | always;
            valid.data[here + i] = before & (unsigned char)(seen & (least[i] > threshold));
        }
    }
}
