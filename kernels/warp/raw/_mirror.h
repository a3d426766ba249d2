#pragma once
// Places beyond a border, mirrored at the last element, which is not repeated.
struct Mirror {
    // The place within n that place i is the mirror image of.
    static CUDA_CALLABLE int at(int i, int n) {
        if (i >= 0 && i < n) return i;  // most are: a remainder takes longer than all else
        const int period = n > 1 ? 2 * n - 2 : 1;
        i = (i < 0 ? -i : i) % period;
        return i < n ? i : period - i;
    }
};

// Call f(t, place of first + t within n) for each t below `length`. On the CPU, places inside have a
// loop of their own, which becomes vector code. (A struct within a function has no templates.)
const auto each_mirrored = [](int first, int length, int n, const auto& f) {
#if defined(__CUDA_ARCH__)
    if (first >= 0 && first + length <= n)
        for (int t = 0; t < length; ++t) f(t, first + t);
    else
        for (int t = 0; t < length; ++t) f(t, Mirror::at(first + t, n));
#else
    const int before = first < 0 ? -first : 0, inside = n - first < length ? n - first : length;
    const int begin = before < length ? before : length, end = inside > begin ? inside : begin;
    for (int t = 0; t < begin; ++t) f(t, Mirror::at(first + t, n));
    for (int t = begin; t < end; ++t) f(t, first + t);
    for (int t = end; t < length; ++t) f(t, Mirror::at(first + t, n));
#endif
};
