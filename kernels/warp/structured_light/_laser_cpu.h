// The brightest window of each line on the CPU, a row of the frame at a time.

// needs TYPE
void find_lines(int first, int last, wp::array_t<TYPE> frames, int axis, int half,
                wp::array_t<int> places) {
    enum { PART = 256 };
    const int height = frames.shape[1], width = frames.shape[2], lines = places.shape[1];
    for (int n = 0; n < places.shape[0]; ++n) {
        const TYPE* frame = frames.data + (size_t)n * height * width;
        int* to = places.data + (size_t)n * lines;
        if (axis == 1) {
            for (int line = first; line < last; ++line) {
                const TYPE* row = frame + (size_t)line * width;
                float best = -__builtin_inff();
                int place = -1;
                for (int p = 0; p < width; ++p) {
                    float total = 0.0f;
                    for (int i = p - half; i <= p + half; ++i)
                        total += (float)row[i < 0 ? 0 : i < width ? i : width - 1];
                    if (total > best) {
                        best = total;
                        place = p;
                    }
                }
                to[line] = place;
            }
            continue;
        }
        for (int left = first; left < last; left += PART) {
            const int count = last - left < PART ? last - left : PART;
            float best[PART], total[PART];
            int place[PART];
            for (int k = 0; k < count; ++k) {
                best[k] = -__builtin_inff();
                place[k] = -1;
            }
            for (int p = 0; p < height; ++p) {
                for (int k = 0; k < count; ++k) total[k] = 0.0f;
                for (int i = p - half; i <= p + half; ++i) {
                    const int at = i < 0 ? 0 : i < height ? i : height - 1;
                    const TYPE* row = frame + (size_t)at * width + left;
#pragma clang loop vectorize(assume_safety)
                    for (int k = 0; k < count; ++k) total[k] += (float)row[k];
                }
#pragma clang loop vectorize(assume_safety)
                for (int k = 0; k < count; ++k) {
                    const bool better = total[k] > best[k];
                    best[k] = better ? total[k] : best[k];
                    place[k] = better ? p : place[k];
                }
            }
            for (int k = 0; k < count; ++k) to[left + k] = place[k];
        }
    }
}
