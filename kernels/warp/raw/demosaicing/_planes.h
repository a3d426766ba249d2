// Between images and planes of floats that are extended by MARGIN pixels, mirrored at the borders.

#include "../_mirror.h"

// needs TYPE, PART, MARGIN
void extend(int row, int left, int right, wp::array_t<TYPE> raw, int top,
            wp::array_t<float> planes) {
    const int height = raw.shape[0], width = raw.shape[1], stored = planes.shape[2];
    const TYPE* from = raw.data + (size_t)Mirror::at(top + row - MARGIN, height) * width;
    float* to = planes.data + (size_t)row * stored;
    const int first = left > MARGIN ? left : MARGIN;
    const int last = right < width + MARGIN ? right : width + MARGIN;
    for (int x = left; x < right && x < first; ++x)
        to[x] = (float)from[Mirror::at(x - MARGIN, width)];
    for (int x = first; x < last; ++x) to[x] = (float)from[x - MARGIN];
    for (int x = last > left ? last : left; x < right; ++x)
        to[x] = (float)from[Mirror::at(x - MARGIN, width)];
}

// needs TYPE, PART, MARGIN, INTEGRAL, HIGHEST
void join(int row, int left, int right, wp::array_t<float> planes, int red, int green, int blue,
          int top, wp::array_t<TYPE> colours) {
    const int width = colours.shape[1], stored = planes.shape[2];
    const size_t plane = (size_t)planes.shape[1] * stored;
    const float* from = planes.data + (size_t)(row + MARGIN) * stored + MARGIN;
    const float* channels[3] = {from + red * plane, from + green * plane, from + blue * plane};
    TYPE* to = colours.data + (size_t)(top + row) * width * 3;
    for (int x = left; x < right; ++x) {
        for (int k = 0; k < 3; ++k) {
            if (INTEGRAL) {
                const float most = (float)HIGHEST;
                float value = channels[k][x] + 0.5f;
                value = value < 0.0f ? 0.0f : value > most ? most : value;
                to[3 * x + k] = (TYPE)(int)value;
            } else {
                to[3 * x + k] = (TYPE)channels[k][x];
            }
        }
    }
}
