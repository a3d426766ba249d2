// Luminance, its logarithm, and colours scaled by powers of 2, of a row of pixels.
#include "_powers.h"

// needs PART, RED, GREEN, BLUE, UNSEEN
void _luminance(int row, int left, int right, wp::array_t<float> radiance, float scale,
                wp::array_t<float> out) {
#pragma clang fp contract(off)
    const int width = out.shape[1], channels = radiance.shape[2];
    const float* from = radiance.data + (size_t)row * width * channels;
    float* to = out.data + (size_t)row * width;
    const auto seen = [](float v) { return v > 0.0f && v < 3.4e38f ? v : 0.0f; };
    const auto write = [=](int x, float light) {
        if (scale > 0.0f)
            to[x] = scale * light;
        else
            to[x] = light > 1.2e-38f ? Powers::log2(light) : UNSEEN;
    };
    if (channels == 3) {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) {
            const float* v = from + 3 * x;
            write(x, (RED * seen(v[0]) + GREEN * seen(v[1])) + BLUE * seen(v[2]));
        }
    } else {
#pragma clang loop vectorize(assume_safety)
        for (int x = left; x < right; ++x) write(x, seen(from[x]));
    }
}

// needs PART, RED, GREEN, BLUE, UNSEEN
void _show(int row, int left, int right, wp::array_t<float> radiance, wp::array_t<float> one,
           float own, wp::array_t<float> two, float other, float offset, wp::array_t<float> out) {
#pragma clang fp contract(off)
    const int width = one.shape[1], channels = radiance.shape[2];
    const size_t start = (size_t)row * width;
    const float *from = radiance.data + start * channels, *a = one.data + start,
                *b = two.data + start;
    float* to = out.data + start * channels;
    for (int x = left; x < right; ++x) {
        const float ratio = Powers::exp2((own * a[x] + other * b[x]) + offset);
        for (int c = 0; c < channels; ++c) {
            const float v = from[x * channels + c];
            const float shown = (v > 0.0f && v < 3.4e38f ? v : 0.0f) * ratio;
            to[x * channels + c] = shown < 1.0f ? shown : 1.0f;
        }
    }
}
