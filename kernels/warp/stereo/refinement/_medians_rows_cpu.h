#include "_medians_cpu.h"

void medians(int slab, int first, int last, wp::array_t<float> disparity,
             wp::array_t<wp::uint8> guide, int radius, int contrast, bool down,
             wp::array_t<float> lines, wp::array_t<wp::uint8> gray_lines,
             wp::array_t<float> smooth) {
    const int height = disparity.shape[0], columns = disparity.shape[1];
    float* const line = lines.data + (size_t)slab * lines.shape[1];
    unsigned char* const gray_line = gray_lines.data + (size_t)slab * gray_lines.shape[1];
    const float* values[MOST];
    const unsigned char* grays[MOST];
    for (int row = first; row < last; ++row) {
        const size_t begin = (size_t)row * columns;
        const float* const from = disparity.data + begin;
        const unsigned char* const gray = guide.data + begin;
        if (!down) {
            for (int x = 0; x < radius; ++x) {
                line[x] = from[0], line[radius + columns + x] = from[columns - 1];
                gray_line[x] = gray[0], gray_line[radius + columns + x] = gray[columns - 1];
            }
            __builtin_memcpy(line + radius, from, columns * sizeof(float));
            __builtin_memcpy(gray_line + radius, gray, columns);
        }
        for (int i = 0; i < 2 * radius + 1; ++i) {
            const int y = row + i - radius, inside = y < 0 ? 0 : y < height ? y : height - 1;
            values[i] = down ? disparity.data + (size_t)inside * columns : line + i;
            grays[i] = down ? guide.data + (size_t)inside * columns : gray_line + i;
        }
        medians_of_row(values, grays, radius, contrast, columns, smooth.data + begin);
    }
}
