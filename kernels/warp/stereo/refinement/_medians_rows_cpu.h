#include "_medians_cpu.h"

void along(int slab, int first, int last, wp::array_t<float> disparity,
           wp::array_t<wp::uint8> guide, int radius, int contrast, wp::array_t<float> lines,
           wp::array_t<wp::uint8> gray_lines, wp::array_t<float> smooth) {
    const int columns = disparity.shape[1];
    float* line = lines.data + (size_t)slab * lines.shape[1];
    unsigned char* gray_line = gray_lines.data + (size_t)slab * gray_lines.shape[1];
    const float* values[MOST];
    const unsigned char* grays[MOST];
    for (int i = 0; i < 2 * radius + 1; ++i) {
        values[i] = line + i;
        grays[i] = gray_line + i;
    }
    for (int row = first; row < last; ++row) {
        const size_t begin = (size_t)row * columns;
        for (int x = 0; x < columns + 2 * radius; ++x) {
            const int i = x - radius < 0 ? 0 : x - radius < columns ? x - radius : columns - 1;
            line[x] = disparity.data[begin + i];
            gray_line[x] = guide.data[begin + i];
        }
        medians_of_row(values, grays, radius, contrast, columns, smooth.data + begin);
    }
}

void down(int slab, int first, int last, wp::array_t<float> disparity, wp::array_t<wp::uint8> guide,
          int radius, int contrast, wp::array_t<float> smooth) {
    const int height = disparity.shape[0], columns = disparity.shape[1];
    const float* values[MOST];
    const unsigned char* grays[MOST];
    for (int row = first; row < last; ++row) {
        for (int i = 0; i < 2 * radius + 1; ++i) {
            const int y = row + i - radius, inside = y < 0 ? 0 : y < height ? y : height - 1;
            values[i] = disparity.data + (size_t)inside * columns;
            grays[i] = guide.data + (size_t)inside * columns;
        }
        medians_of_row(values, grays, radius, contrast, columns,
                       smooth.data + (size_t)row * columns);
    }
}
