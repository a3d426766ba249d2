// Two entries of float16 pairs, by one load of 16 bytes if both are within them.
auto two_halves(wp::array_t<Pair> table, int low, int high) {
    const unsigned int a = low, b = high;
    const uint4 near = __ldg((const uint4*)table.data + a / 4);
    auto pick = [&](unsigned int n) {
        return n & 2 ? (n & 1 ? near.w : near.z) : (n & 1 ? near.y : near.x);
    };
    unsigned int found[2] = {pick(a), pick(b)};
    if (a / 4 != b / 4) found[1] = __ldg((const unsigned int*)table.data + b);
    wp::vec_t<4, float> numbers;
#pragma unroll
    for (int n = 0; n < 4; ++n) {
        wp::half number;
        number.u = found[n / 2] >> 16 * (n % 2);
        numbers[n] = wp::half_to_float(number);
    }
    return numbers;
}

// The same of float32 pairs.
auto two_floats(wp::array_t<Pair> table, int low, int high) {
    const unsigned int a = low, b = high;
    const float4 near = __ldg((const float4*)table.data + a / 2);
    const float2 here = {a & 1 ? near.z : near.x, a & 1 ? near.w : near.y};
    float2 next = {b & 1 ? near.z : near.x, b & 1 ? near.w : near.y};
    if (a / 2 != b / 2) next = __ldg((const float2*)table.data + b);
    return wp::vec_t<4, float>(here.x, here.y, next.x, next.y);
}

// needs WORD
// Write adjacent features, in words of up to 16 bytes.
void store(wp::array_t<Scalar> features, int sample, int group, Numbers numbers) {
    constexpr int COUNT = sizeof(numbers) / sizeof(WORD);
    WORD words[COUNT];
    memcpy(words, &numbers, sizeof(numbers));
    WORD* to = (WORD*)(features.data + (size_t)sample * features.shape[1]) + group * COUNT;
#pragma unroll
    for (int i = 0; i < COUNT; ++i) to[i] = words[i];
}

bool begins_run(wp::int64 key) {
    const long long before = __shfl_up_sync(0xffffffffu, key, 1);
    return (threadIdx.x & 31) == 0 || key != before;
}

// After n steps a lane has the sum over itself and those of the next 2^n - 1 lanes in its run.
auto add_up_run(bool begins, wp::vec_t<16, float> values) {
    const int lane = threadIdx.x & 31;
    const unsigned int behind = __ballot_sync(0xffffffffu, begins) & 0xfffffffeu << lane;
    const int end = behind ? __ffs(behind) - 1 : 32;
    wp::vec_t<16, float> sums = values;
    for (int step = 1; __any_sync(0xffffffffu, lane + step < end); step *= 2)
#pragma unroll
        for (int i = 0; i < 16; ++i) {
            const float more = __shfl_down_sync(0xffffffffu, sums[i], step);
            if (lane + step < end) sums[i] += more;
        }
    return sums;
}

void add_two(wp::array_t<wp::vec_t<2, float>> table, int low, int high, float x, float y, float z,
             float w) {
    float* numbers = (float*)table.data;
#if __CUDA_ARCH__ >= 900
    if ((low ^ high) == 1) {
        const bool turned = high < low;
        const float a = turned ? z : x, b = turned ? w : y, c = turned ? x : z, d = turned ? y : w;
        float* to = numbers + 2 * (size_t)(turned ? high : low);
        asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};" ::"l"(to), "f"(a), "f"(b),
                     "f"(c), "f"(d)
                     : "memory");
        return;
    }
    float* first = numbers + 2 * (size_t)low;
    float* second = numbers + 2 * (size_t)high;
    asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(first), "f"(x), "f"(y) : "memory");
    asm volatile("red.global.add.v2.f32 [%0], {%1, %2};" ::"l"(second), "f"(z), "f"(w) : "memory");
#else
    atomicAdd(numbers + 2 * (size_t)low, x);
    atomicAdd(numbers + 2 * (size_t)low + 1, y);
    atomicAdd(numbers + 2 * (size_t)high, z);
    atomicAdd(numbers + 2 * (size_t)high + 1, w);
#endif
}
