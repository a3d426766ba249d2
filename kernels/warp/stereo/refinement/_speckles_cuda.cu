// Return the first pixel of this pixel's run, among the pixels of its warp.
int start_of_run(int pixel, int pixels, bool begins) {
    const int lane = threadIdx.x % 32, rest = pixels - (pixel - lane);
    const unsigned mask = 0xffffffffu >> (rest < 32 ? 32 - rest : 0);
    const unsigned starts = __ballot_sync(mask, begins || lane == 0);
    return pixel - lane + 31 - __clz(starts & (0xffffffffu >> (31 - lane)));
}

// Return how many threads of the warp have this label, to the first of them; 0 to the others. All
// threads of the warp that have a pixel call this.
int number_of_label(int pixel, int pixels, int label) {
    const int lane = threadIdx.x % 32, rest = pixels - (pixel - lane);
    const unsigned mask = 0xffffffffu >> (rest < 32 ? 32 - rest : 0);
    const unsigned same = __match_any_sync(mask, label);
    return __ffs(same) - 1 == lane ? __popc(same) : 0;
}
