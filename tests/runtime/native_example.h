#include "native_shared.h"

// needs RADIUS
// Mean of 2 RADIUS + 1 pixels along a row; the borders are repeated.
void blur_row(int row, wp::array_t<float> image, wp::array_t<float> out) {
    const int width = image.shape[1];
    for (int x = 0; x < width; ++x) {
        float sum = 0.0f;
        for (int k = -RADIUS; k <= RADIUS; ++k)
            sum += image.data[(size_t)row * width + Ends::within(x + k, width)];
        out.data[(size_t)row * width + x] = sum / (2 * RADIUS + 1);
    }
}

void add_one(wp::array_t<int> out) { out.data[0] += 1; }

int plus_one(int number) { return number + 1; }

void without_an_end(int number) {
