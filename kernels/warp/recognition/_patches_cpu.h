// needs WHITE
// Round some pixels to integers; a pixel that is no number becomes 0.
void round_some(int first, int last, wp::array_t<float> image, wp::array_t<int> pixels) {
    const float* from = image.data;
    int* to = pixels.data;
#pragma clang loop vectorize(assume_safety)
    for (size_t i = first; i < last; ++i) {
        float value = from[i] > 0.0f ? from[i] : 0.0f;
        value = value < 1.0f ? value : 1.0f;
        to[i] = (int)(value * WHITE + 0.5f);
    }
}

// needs LANES, LARGEST_PATCH, SPREAD, LARGEST
// Cut out a patch and normalise it; patches.py has the rule. 16 pixels at a time.
void sample_patch(int i, wp::array_t<int> pixels, wp::array_t<int> corners, int side,
                  wp::int64 least, wp::array_t<wp::int8> patches) {
    typedef int lanes __attribute__((vector_size(4 * LANES)));
    typedef double wide __attribute__((vector_size(8 * LANES)));
    typedef signed char bytes __attribute__((vector_size(LANES)));
    const int size = patches.shape[1], count = side * side;
    const size_t width = corners.data[2 * i + 1];
    const int* from = pixels.data + corners.data[2 * i];
    alignas(64) int own[LARGEST_PATCH];
    for (int k = count; k < size; ++k) own[k] = 0;
    for (int row = 0; row < side; ++row)
        __builtin_memcpy(own + row * side, from + row * width, sizeof(int) * side);
    // A lane adds up at most 40 squares below 2^24.
    lanes sums = {}, squares = {};
    for (int k = 0; k < size; k += LANES) {
        const lanes x = *(const lanes*)(own + k);
        sums += x;
        squares += x * x;
    }
    const int total = __builtin_reduce_add(sums);
    wp::int64 square = 0;
    for (int j = 0; j < LANES; ++j) square += (unsigned int)squares[j];
    square = count * square - (wp::int64)total * total;
    wp::int64 root = (wp::int64)__builtin_sqrt((double)square);
    while (root * root > square) --root;
    while ((root + 1) * (root + 1) <= square) ++root;
    signed char* out = (signed char*)patches.data + (size_t)i * size;
    if (root < least) {
        for (int k = 0; k < size; ++k) out[k] = 0;
        return;
    }
    const double scale = (double)SPREAD / (double)(root > 1 ? root : 1);
    for (int k = 0; k < size; k += LANES) {
        const lanes x = count * *(const lanes*)(own + k) - total;
        const wide value = __builtin_convertvector(x, wide) * scale + (0.5 + 0x1p-30);
        lanes whole = __builtin_convertvector(__builtin_elementwise_floor(value), lanes);
        whole = __builtin_elementwise_max(whole, (lanes){} - LARGEST);
        whole = __builtin_elementwise_min(whole, (lanes){} + LARGEST);
        const bytes narrow = __builtin_convertvector(whole, bytes);
        __builtin_memcpy(out + k, &narrow, sizeof narrow);
    }
    for (int k = count; k < size; ++k) out[k] = 0;
}
